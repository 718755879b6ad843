//! The result of tracing a ray.

use field::Real;

/// How a ray ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The ray crosses the surface from outside to inside.
    Hit,
    /// The ray does not cross the surface within its interval, or `Options::step_limit` ended it.
    Miss,
    /// The ray starts inside the solid, f ≤ 0.
    Inside,
    /// f was a NaN or an infinity.
    Invalid,
}

/// The result of tracing one ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intersection<R> {
    /// How the ray ended.
    pub outcome: Outcome,
    /// The distance of the hit along the ray; for a miss, the distance of the closest approach.
    pub t: R,
    /// f at `t`. For a miss that stayed clear of the surface this is the minimum of a parabola
    /// through the three nearest points, not an evaluated value.
    pub f: R,
    /// The smallest f/(L t) over the closest approaches that the ray passed, with L the steepest
    /// slope |Δf/Δt| met along the ray, at least 1. This is the tangent of the angle between the
    /// ray and the solid. For a hit, only approaches before the hit count. Infinite if there was no
    /// approach.
    pub clearance: R,
    /// The distance along the ray of that closest approach; 0 if there was none.
    pub nearest: R,
    /// The number of evaluations of f, at most `Options::step_limit` + 200 for rays of up to 16
    /// scales.
    pub steps: u32,
}

impl<R: Real> Intersection<R> {
    /// The result of a ray before its first evaluation: a miss.
    pub fn unfinished() -> Self {
        Intersection {
            outcome: Outcome::Miss,
            t: R::zero(),
            f: R::infinity(),
            clearance: R::infinity(),
            nearest: R::zero(),
            steps: 0,
        }
    }
}
