//! The smoothness of a volume: the total variation of its features.

use field::Real;

use crate::background::grid::{FEATURES, LEVELS, entries, entry, table_length};
use crate::background::volume::Volume;

/// The difference of neighbours at which the variation turns from quadratic to linear.
///
/// Features of trained volumes are of the order of 1.
const EDGE: f64 = 0.05;

/// The largest stable step, in units of [`EDGE`]: a corner has six neighbours, and both ends of a
/// difference move.
const LARGEST_STEP: f64 = 1.0 / 12.0;

impl<R: Real> Volume<R> {
    /// One step of gradient descent on the total variation of the features: on each level, the sum
    /// over neighbours along the axes of H(difference), where H is |d| from `EDGE` = 0.05 on and a
    /// parabola below, with a continuous slope.
    ///
    /// `parameters` are those of a volume. `step` is the largest change of a feature by one of its
    /// neighbours; above 0.004 it is taken as 0.004, which is stable.
    ///
    /// A grid has no other link between its cells: without this, matter that only one photograph
    /// sees takes any radiance that this photograph asks for. The variation of a border between two
    /// colours depends on its height, not on its steepness, so borders stay.
    ///
    /// Total variation: Rudin, Osher and Fatemi, "Nonlinear Total Variation Based Noise Removal
    /// Algorithms", Physica D 1992. Of grids of radiance: Fridovich-Keil, Yu, Tancik, Chen, Recht
    /// and Kanazawa, "Plenoxels: Radiance Fields without Neural Networks", CVPR 2022, section 3.3.
    ///
    /// # Panics
    /// If `parameters` has fewer numbers than the tables of a volume.
    pub fn smooth(parameters: &mut [R], step: R) {
        let step = step.min(R::of(LARGEST_STEP * EDGE));
        let (tables, _) = parameters.split_at_mut(table_length());
        let mut start = 0;
        for cells in LEVELS {
            let level = &mut tables[start..start + FEATURES * entries(cells)];
            let old = level.to_vec();
            smooth_level(&old, level, cells, step);
            start += level.len();
        }
    }
}

/// The same for one level of `cells` cells along a side, from the features `old` to `new`.
fn smooth_level<R: Real>(old: &[R], new: &mut [R], cells: usize, step: R) {
    let inverse = R::of(EDGE).recip();
    let slope = |difference: R| (difference * inverse).max(-R::one()).min(R::one());
    for axis in 0..3 {
        let mut unit = [0; 3];
        unit[axis] = 1;
        let stride = FEATURES * entry(unit, cells);
        for (z, y) in (0..=cells).flat_map(|z| (0..=cells).map(move |y| (z, y))) {
            // Along x, the last corner of a row has no neighbour; along y and z, the last rows.
            if [0, y, z][axis] == cells && axis > 0 {
                continue;
            }
            let row = FEATURES * entry([0, y, z], cells);
            let length = FEATURES * if axis == 0 { cells } else { cells + 1 };
            for i in row..row + length {
                let change = step * slope(old[i + stride] - old[i]);
                new[i] += change;
                new[i + stride] -= change;
            }
        }
    }
}
