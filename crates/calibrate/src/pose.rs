//! The parameters of a pose.

use field::Sphere;
use glam::{DMat3, DVec3};
use render::Camera;

use crate::freedom::OF_POSE;
use crate::units::focal;

/// The least distance of an eye from the centre of the bounding sphere that counts, in radii.
const NEAREST: f64 = 0.1;

/// The map from six parameters of a view, in pixels, to a turn about the eye and a shift of it.
///
/// The first three parameters are a turn alone, about the axes of the image. The others are a shift
/// along these axes, and with it the turn that keeps the sphere's centre at its place in the image.
/// So the first two move the image of the object, the third rolls it, and the others show it from
/// another side, from closer, and move all that is before and behind it. Shifts without this turn
/// move the object as turns do: then each parameter takes half of every motion of the object, and
/// little tells which of them was wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PoseMap {
    /// The rightward, the upward and the forward axis of the given camera.
    axes: DMat3,
    /// Radians about each axis per pixel.
    turn: DVec3,
    /// World units of a shift per pixel.
    shift: f64,
    /// The vector from the eye to the sphere's centre over its squared length.
    aim: DVec3,
}

impl PoseMap {
    pub(crate) fn new(camera: &Camera, sphere: &Sphere<f64>) -> Self {
        let to = sphere.center - camera.eye;
        let distance = to.length().max(NEAREST * sphere.radius);
        let turn = 1.0 / focal(camera);
        // A roll moves the border of the object as far as the other turns move all of it.
        let lever = (distance / sphere.radius).max(1.0);
        PoseMap {
            axes: DMat3::from_cols(camera.right, camera.up, camera.forward),
            turn: DVec3::new(1.0, 1.0, lever) * turn,
            shift: distance * turn,
            aim: to / (distance * distance),
        }
    }

    /// The rotation vector and the shift of the eye of these parameters.
    pub(crate) fn pose(&self, [a, b, c, x, y, z]: [f64; OF_POSE]) -> (DVec3, DVec3) {
        let shift = self.axes * (DVec3::new(x, y, z) * self.shift);
        (self.axes * (DVec3::new(a, b, c) * self.turn) + shift.cross(self.aim), shift)
    }

    /// The parameters of a rotation vector and a shift of the eye.
    pub(crate) fn parameters(&self, turn: DVec3, shift: DVec3) -> [f64; OF_POSE] {
        let own = self.axes.transpose();
        let [a, b, c] = ((own * (turn - shift.cross(self.aim))) / self.turn).to_array();
        let [x, y, z] = (own * shift / self.shift).to_array();
        [a, b, c, x, y, z]
    }

    /// VJP of [`pose`](Self::pose).
    pub(crate) fn vjp(&self, turn: DVec3, shift: DVec3) -> [f64; OF_POSE] {
        let own = self.axes.transpose();
        let [a, b, c] = (own * turn * self.turn).to_array();
        let [x, y, z] = (own * (shift + self.aim.cross(turn)) * self.shift).to_array();
        [a, b, c, x, y, z]
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use glam::{DQuat, DVec2};

    use super::*;

    #[test]
    fn a_shift_keeps_the_centre_of_the_sphere_at_its_place_in_the_image() {
        let sphere = Sphere { center: DVec3::new(0.3, -0.2, 0.5), radius: 1.2 };
        let (focal, middle) = (DVec2::splat(150.0), DVec2::new(62.0, 51.0));
        let (eye, target) = (DVec3::new(3.0, 2.0, 4.0), sphere.center + DVec3::splat(0.4));
        let camera = Camera::look_at(120, 100, focal, middle, eye, target, DVec3::Z).unwrap();
        let map = PoseMap::new(&camera, &sphere);
        let before = camera.project(sphere.center).unwrap();
        for i in 0..OF_POSE {
            let mut parameters = [0.0; OF_POSE];
            parameters[i] = 0.1;
            let (turn, shift) = map.pose(parameters);
            assert_relative_eq!(map.parameters(turn, shift)[..], parameters[..], epsilon = 1e-12);
            let turn = DQuat::from_scaled_axis(turn);
            let [right, up, forward] = [camera.right, camera.up, camera.forward].map(|v| turn * v);
            let moved = Camera { right, up, forward, eye: eye + shift, ..camera };
            let motion = moved.project(sphere.center).unwrap().distance(before);
            if i < 3 {
                assert!(motion < 0.11, "a turn by 0.1 moves the centre by {motion} pixels");
            } else {
                assert!(motion < 1e-3, "a shift by 0.1 moves the centre by {motion} pixels");
            }
        }
    }
}
