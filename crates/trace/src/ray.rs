//! Rays, each with the interval in which it is traced.

use field::{Real, Sphere};

/// The ray o + t d with |d| = 1, for t in [near, far]. Lengths are in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray<R: Real> {
    /// The origin o.
    pub origin: R::Vec3,
    /// The direction d, of length 1.
    pub direction: R::Vec3,
    /// The distance at which tracing starts, ≥ 0.
    pub near: R,
    /// The distance at which tracing ends.
    pub far: R,
    /// The unit of the lengths in `Options`: the bounding radius, unless the caller sets another.
    pub scale: R,
    /// The growth of that unit along the ray, for the shortest step: it is `spread` · t where that
    /// is more than `scale`. 0 unless the caller sets another.
    pub spread: R,
    /// Closest approaches with at least this clearance do not matter: [`intersect_rows`] can leave
    /// them out where a lattice shows them. Infinite unless the caller sets another.
    ///
    /// [`intersect_rows`]: crate::intersect_rows
    pub reach: R,
}

impl<R: Real> Ray<R> {
    /// The part of a ray inside the ball `bounds`, or `None` if the ray misses the ball.
    pub fn enter(origin: R::Vec3, direction: R::Vec3, bounds: &Sphere<R>) -> Option<Self> {
        let (near, far) = bounds.clip(origin, direction)?;
        Some(Ray {
            origin,
            direction,
            near,
            far,
            scale: bounds.radius,
            spread: R::zero(),
            reach: R::infinity(),
        })
    }

    /// The point at distance `t`.
    pub fn at(&self, t: R) -> R::Vec3 {
        self.origin + self.direction * t
    }
}
