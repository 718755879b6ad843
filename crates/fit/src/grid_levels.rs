//! The grid of splines of a fit.

use sdf_nn::grids::{Degree, GridLevels, SplineSize};

/// Features of a level.
const FEATURES: usize = 2;

/// The most coefficients along a side of a level whose nodes are all free from the start. Finer
/// levels would take most of the time of an iteration, and a soft surface has no use for them.
const COARSE: usize = 32;

/// Whether the nodes of a level are free near the surface only, once it is sharp.
pub(crate) fn is_fine(side: usize) -> bool {
    side > COARSE
}

/// The size of the splines.
pub(crate) fn spline_size(levels: &GridLevels) -> SplineSize {
    SplineSize { levels: levels.0.clone(), features: FEATURES, degree: Degree::Quadratic }
}
