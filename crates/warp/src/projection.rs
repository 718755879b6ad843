//! Charts between world and film.

use field::{Real, Vector3};
use glam::DVec3;

/// The chart between world and film: u = projection of x, in pixels.
pub trait Projection<R: Real> {
    /// The rows ∂u_x/∂x and ∂u_y/∂x at the point `x`, in pixels per world unit.
    fn jacobian(&self, x: R::Vec3) -> [R::Vec3; 2];
    /// The derivatives of these rows as the point moves along `dx`.
    fn jacobian_derivative(&self, x: R::Vec3, dx: R::Vec3) -> [R::Vec3; 2];
}

/// The chart of a pinhole camera: u = principal point + focal · (r·axis)/(r·forward), r = x − eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// The eye, in world units.
    pub eye: DVec3,
    /// The unit vector along the optical axis, away from the camera.
    pub forward: DVec3,
    /// The unit vectors along which u_x and u_y grow.
    pub axes: [DVec3; 2],
    /// The focal lengths along the two axes, in pixels.
    pub focal: [f64; 2],
}

impl Pinhole {
    /// The chart of an eye at `eye` that looks at `target`, with u_y growing against `up`.
    ///
    /// `up` must not be parallel to the view; `focal` is in pixels.
    pub fn looking_at(eye: DVec3, target: DVec3, up: DVec3, focal: f64) -> Self {
        let forward = (target - eye).normalize();
        let right = forward.cross(up).normalize();
        Pinhole { eye, forward, axes: [right, forward.cross(right)], focal: [focal; 2] }
    }
}

impl<R: Real> Projection<R> for Pinhole {
    fn jacobian(&self, x: R::Vec3) -> [R::Vec3; 2] {
        let r = x - R::Vec3::of(self.eye);
        let forward = R::Vec3::of(self.forward);
        let depth = r.dot(forward);
        std::array::from_fn(|e| {
            let axis = R::Vec3::of(self.axes[e]);
            (axis - forward * (axis.dot(r) / depth)) * (R::of(self.focal[e]) / depth)
        })
    }

    fn jacobian_derivative(&self, x: R::Vec3, dx: R::Vec3) -> [R::Vec3; 2] {
        let r = x - R::Vec3::of(self.eye);
        let forward = R::Vec3::of(self.forward);
        let (depth, depth_dot) = (r.dot(forward), forward.dot(dx));
        let jacobian = Projection::<R>::jacobian(self, x);
        jacobian.map(|row| (forward * row.dot(dx) + row * depth_dot) * (-R::one() / depth))
    }
}
