//! The first hit of every ray of a batch.

use field::{Field, Real};

use crate::intersection::Intersection;
use crate::lattice::Lattice;
use crate::march::{RayState, Tracer};
use crate::options::Options;
use crate::ray::Ray;

/// The largest number of rays that are followed at the same time: where one ends, another starts.
///
/// Their states should stay in the caches (184 bytes a ray in double precision), and a network
/// needs many points at once. With 256 and with 1024, images of a ball and of a network and
/// derivatives of a ball take 0.96 to 1.03 times as long, which is the spread of repeated runs.
const ON_THE_WAY: usize = 512;

/// Finds the first crossing from f > 0 to f ≤ 0 of every ray.
///
/// One call of [`Field::value`] evaluates up to 512 rays. `out` is cleared and gets one element per
/// ray, in the order of `rays`. A ray costs at most `Options::step_limit` evaluations (more
/// if it is longer than 16 scales), and up to 200 more where it has to refine a root.
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
    intersect_rows(field, None, &mut rows, |row| Some((row.0, &mut row.1)), options);
    out.clear();
    out.extend(rows.into_iter().map(|(_, found)| found));
}

/// Like [`intersect`], for rays inside of rows of the caller, with each result in its row.
///
/// With a `lattice` of the field, rays skip the parts that it shows to be empty.
///
/// `parts` gives the ray of a row and the place of its result, [`Intersection::unfinished`] at the
/// start; `None` for a row without a ray.
pub fn intersect_rows<R: Real, T>(
    field: &(impl Field<R> + ?Sized),
    lattice: Option<&Lattice<R>>,
    rows: &mut [T],
    parts: impl for<'a> Fn(&'a mut T) -> Option<(&'a Ray<R>, &'a mut Intersection<R>)>,
    options: &Options<R>,
) {
    let mut next = 0;
    let mut start = |rows: &mut [T]| loop {
        let number = next;
        let row = rows.get_mut(number)?;
        next += 1;
        let Some((ray, found)) = parts(row) else { continue };
        let mut state = RayState::new(ray.near, options);
        if Tracer::new(ray, options, lattice, ray.near, found).skip(&mut state, ray.near) {
            break Some(((number, state), ray.at(state.t)));
        }
    };
    // The rays on the way, by the numbers of their rows, and the points of their next evaluations.
    let (mut on_the_way, mut x): (Vec<_>, Vec<_>) =
        std::iter::from_fn(|| start(rows)).take(ON_THE_WAY).unzip();
    let mut f = vec![R::zero(); x.len()];
    while !x.is_empty() {
        let f = &mut f[..x.len()];
        field.value(&x, f);
        // Backwards: the ray that takes the place of a finished one has had its value.
        for (i, f) in f.iter().enumerate().rev() {
            let (number, state) = &mut on_the_way[i];
            let Some((ray, found)) = parts(&mut rows[*number]) else { continue };
            if Tracer::new(ray, options, lattice, state.t, found).take_value(state, *f) {
                x[i] = ray.at(state.t);
            } else if let Some(started) = start(rows) {
                (on_the_way[i], x[i]) = started;
            } else {
                on_the_way.swap_remove(i);
                x.swap_remove(i);
            }
        }
    }
}
