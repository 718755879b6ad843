//! The first hit of every ray of a batch.

use field::{Field, Real};

use crate::march::{RayState, Tracer};
use crate::{Options, Ray};

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
    /// The number of evaluations of f, at most `Options::step_limit` + 200.
    pub steps: u32,
}

/// Finds the first crossing from f > 0 to f ≤ 0 of every ray.
///
/// One call of [`Field::value`] evaluates all unfinished rays at once. `out` is cleared and gets
/// one element per ray, in the order of `rays`. A ray costs at most `Options::step_limit`
/// evaluations, and up to 200 more where it has to refine a root.
///
/// The options are not checked here; see [`Options::validate`].
pub fn intersect<R: Real>(
    field: &(impl Field<R> + ?Sized),
    rays: &[Ray<R>],
    options: &Options<R>,
    out: &mut Vec<Intersection<R>>,
) {
    out.clear();
    out.resize(rays.len(), unfinished());
    let start = |ray: usize| RayState::new(ray, rays[ray].near, options);
    let mut active: Vec<RayState<R>> = (0..rays.len()).map(start).collect();
    let (mut x, mut f) = (Vec::with_capacity(rays.len()), vec![R::zero(); rays.len()]);
    while !active.is_empty() {
        x.clear();
        x.extend(active.iter().map(|s| rays[s.ray].at(s.t)));
        let f = &mut f[..active.len()];
        field.value(&x, f);
        let mut values = f.iter();
        active.retain_mut(|state| {
            let f = values.next().copied().unwrap_or(R::nan());
            let (ray, found) = (&rays[state.ray], &mut out[state.ray]);
            let min_step = options.min_step * ray.scale;
            Tracer { ray, options, min_step, found }.take_value(state, f)
        });
    }
}

/// A result before the first evaluation.
fn unfinished<R: Real>() -> Intersection<R> {
    Intersection {
        outcome: Outcome::Miss,
        t: R::zero(),
        f: R::infinity(),
        clearance: R::infinity(),
        nearest: R::zero(),
        steps: 0,
    }
}
