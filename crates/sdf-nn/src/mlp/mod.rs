//! A multilayer perceptron on blocks of points: its layers, its parameters and their packing.
//!
//! - [`perceptron`]: layers, parameters and packed weights.
//! - [`scratch`]: the working memory of the sweeps; [`memory`] hands it to calls.
//! - [`forward`] and [`backward`]: the two sweeps through all layers.
//! - [`few`]: both sweeps for a few points.
//! - [`activate`]: the nonlinearity σ(z) and its derivatives.

mod activate;
mod backward;
mod few;
mod forward;
mod memory;
mod perceptron;
mod scratch;

pub(crate) use perceptron::{LayerShape, Mlp};
pub(crate) use scratch::{FewMemory, MAX_SWEEP_POINTS, Scratch};
