//! The gauge: the motions and the scaling of the world, which no photograph shows.

use field::Sphere;
use glam::DVec3;
use render::Camera;

use crate::calibrate::freedom::OF_POSE;
use crate::calibrate::units::of_pose;

/// Motions of the world: three shifts, three turns, and a scaling.
const MOTIONS: usize = 7;

/// A vector whose part that is independent of the others is shorter than this, relative to its own
/// length, counts as dependent.
const INDEPENDENT: f64 = 1e-9;

/// An orthonormal basis of the corrections of poses that equal a motion of the world, to first
/// order, in units of [`of_pose`].
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Gauge {
    basis: Vec<Vec<f64>>,
}

impl Gauge {
    pub(crate) fn new(cameras: &[Camera], sphere: &Sphere<f64>) -> Self {
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for number in 0..MOTIONS {
            let mut motion: Vec<f64> =
                cameras.iter().flat_map(|camera| motion(number, camera, sphere)).collect();
            let length = norm(&motion);
            for unit in &basis {
                remove(unit, &mut motion);
            }
            let left = norm(&motion);
            if left > INDEPENDENT * length {
                motion.iter_mut().for_each(|v| *v /= left);
                basis.push(motion);
            }
        }
        Gauge { basis }
    }

    /// Removes the motion of the world from corrections of all poses.
    pub(crate) fn hold(&self, poses: &mut [f64]) {
        self.basis.iter().for_each(|unit| remove(unit, poses));
    }
}

/// The correction of a camera that equals motion `number` of the world about the sphere's centre.
fn motion(number: usize, camera: &Camera, sphere: &Sphere<f64>) -> [f64; OF_POSE] {
    let arm = camera.eye - sphere.center;
    let axis = DVec3::AXES[number % 3];
    let (turn, shift) = match number {
        0..3 => (DVec3::ZERO, axis * sphere.radius),
        3..6 => (axis, axis.cross(arm)),
        _ => (DVec3::ZERO, arm),
    };
    let units = of_pose(camera, sphere);
    let all = [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z];
    std::array::from_fn(|i| all[i] / units[i])
}

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// Removes the part along a unit vector.
fn remove(unit: &[f64], from: &mut [f64]) {
    let along: f64 = unit.iter().zip(from.iter()).map(|(a, b)| a * b).sum();
    from.iter_mut().zip(unit).for_each(|(v, u)| *v -= along * u);
}
