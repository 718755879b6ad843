//! The grid of splines of a fit.

use grids::{Degree, GridLevels, SplineSize};

/// Features of a level.
const FEATURES: usize = 2;

/// The most coefficients along a side of a level whose nodes are all free from the start. Finer
/// levels would take most of the time of an iteration, and a soft surface has no use for them.
const COARSE: usize = 32;

/// Whether the nodes of a level are free near the surface only, once it is sharp.
pub(crate) fn is_fine(side: usize) -> bool {
    side > COARSE
}

/// Nodes near the surface, in units of the nodes of a square across the ball: the area of a sphere
/// of its size times the nodes across the band.
const NODES_OF_SQUARE: u64 = 19;

/// Bytes of memory for each coefficient of a level, free or not: the tables of the model, its
/// copies, and the model file that is written.
const MEMORY_PER_COEFFICIENT: u64 = 16;

/// The size of the splines.
pub(crate) fn spline_size(levels: &GridLevels) -> SplineSize {
    SplineSize { levels: levels.0.clone(), features: FEATURES, degree: Degree::Quadratic }
}

/// An estimate of the memory of the splines, in bytes; `of_parameter` is that of a parameter.
pub(crate) fn spline_memory(levels: &GridLevels, of_parameter: u64) -> u64 {
    let of_level = |side: &usize| {
        let all = (*side as u64).pow(3);
        let free = if is_fine(*side) { NODES_OF_SQUARE * (*side as u64).pow(2) } else { all };
        FEATURES as u64 * (free * of_parameter + all * MEMORY_PER_COEFFICIENT)
    };
    levels.0.iter().map(of_level).sum()
}
