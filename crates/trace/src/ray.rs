//! Rays with the interval in which they are followed.

use field::{Real, Sphere};

/// The ray o + t d, |d| = 1, for t in [near, far]; lengths in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray<R: Real> {
    /// o.
    pub origin: R::Vec3,
    /// d, of length 1.
    pub direction: R::Vec3,
    /// Where tracing starts, ≥ 0.
    pub near: R,
    /// Where tracing ends.
    pub far: R,
    /// The length that relative lengths of the options refer to: the bounding radius.
    pub scale: R,
}

impl<R: Real> Ray<R> {
    /// The part of a ray inside a ball, or `None` if it misses.
    pub fn enter(origin: R::Vec3, direction: R::Vec3, bounds: &Sphere<R>) -> Option<Self> {
        let (near, far) = bounds.clip(origin, direction)?;
        Some(Ray { origin, direction, near, far, scale: bounds.radius })
    }

    /// The point at distance `t`.
    pub fn at(&self, t: R) -> R::Vec3 {
        self.origin + self.direction * t
    }
}
