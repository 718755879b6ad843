//! The sizes of a model's networks.

use sdf_nn::Encoding;
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

/// The frequency encoding of `bands` octaves; none for 0.
pub(crate) fn encoding(bands: usize) -> Encoding {
    if bands == 0 { Encoding::None } else { Encoding::Frequency { bands } }
}

/// The number of weights and biases of a perceptron with `layers` hidden layers of `width`.
pub(crate) fn mlp_parameters(inputs: usize, width: usize, layers: usize, outputs: usize) -> u64 {
    let [inputs, width, layers, outputs] = [inputs, width, layers, outputs].map(|n| n as u64);
    (inputs + 1) * width + (layers - 1) * (width + 1) * width + (width + 1) * outputs
}
