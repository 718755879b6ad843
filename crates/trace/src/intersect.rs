//! The first hit of every ray of a batch.

use field::{Field, Real};

use crate::intersection::{Intersection, Outcome};
use crate::march::{RayState, Tracer};
use crate::options::Options;
use crate::ray::Ray;

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
    let mut states: Vec<RayState<R>> =
        rays.iter().map(|ray| RayState::new(ray.near, options)).collect();
    // The unfinished rays. Their numbers are removed; the states are too large to be moved.
    let mut active: Vec<usize> = (0..rays.len()).collect();
    let (mut x, mut f) = (Vec::with_capacity(rays.len()), vec![R::zero(); rays.len()]);
    while !active.is_empty() {
        x.clear();
        x.extend(active.iter().map(|i| rays[*i].at(states[*i].t)));
        let f = &mut f[..active.len()];
        field.value(&x, f);
        let mut values = f.iter();
        active.retain(|i| {
            let f = values.next().copied().unwrap_or(R::nan());
            let (ray, found) = (&rays[*i], &mut out[*i]);
            let min_step = options.min_step * ray.scale;
            Tracer { ray, options, min_step, found }.take_value(&mut states[*i], f)
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
