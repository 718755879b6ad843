//! The first hit of every ray of a batch.

use field::{Field, Real};

use crate::intersection::Intersection;
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
    let mut rows: Vec<(&Ray<R>, Intersection<R>)> =
        rays.iter().map(|ray| (ray, Intersection::unfinished())).collect();
    intersect_rows(field, &mut rows, |row| Some((row.0, &mut row.1)), options);
    out.clear();
    out.extend(rows.into_iter().map(|(_, found)| found));
}

/// Like [`intersect`], for rays inside of rows of the caller, with each result in its row.
///
/// `parts` gives the ray of a row and the place of its result, [`Intersection::unfinished`] at the
/// start; `None` for a row without a ray.
pub fn intersect_rows<R: Real, T>(
    field: &(impl Field<R> + ?Sized),
    rows: &mut [T],
    parts: impl for<'a> Fn(&'a mut T) -> Option<(&'a Ray<R>, &'a mut Intersection<R>)>,
    options: &Options<R>,
) {
    // The unfinished rays: the numbers of their states, which are too large to be moved.
    let (mut states, mut active, mut x) = (Vec::new(), Vec::new(), Vec::new());
    for (number, row) in rows.iter_mut().enumerate() {
        if let Some((ray, _)) = parts(row) {
            active.push(states.len());
            x.push(ray.at(ray.near));
            states.push((number, RayState::new(ray.near, options)));
        }
    }
    let mut f = vec![R::zero(); active.len()];
    while !active.is_empty() {
        let f = &mut f[..active.len()];
        field.value(&x, f);
        x.clear();
        let mut values = f.iter();
        active.retain(|i| {
            let f = values.next().copied().unwrap_or(R::nan());
            let (number, state) = &mut states[*i];
            let Some((ray, found)) = parts(&mut rows[*number]) else { return false };
            let min_step = options.min_step * ray.scale;
            let unfinished = Tracer { ray, options, min_step, found }.take_value(state, f);
            if unfinished {
                x.push(ray.at(state.t));
            }
            unfinished
        });
    }
}
