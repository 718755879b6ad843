//! A multilayer perceptron on blocks of points: its layers, its parameters and their packing.
//!
//! - [`perceptron`]: layers, parameters and packed weights.
//! - [`scratch`]: the working memory of the sweeps.
//! - [`forward`] and [`backward`]: the two sweeps through all layers.
//! - [`few`]: both sweeps for a few points.
//! - [`activate`]: the nonlinearity σ(z) and its derivatives.

mod activate;
mod backward;
mod few;
mod forward;
mod perceptron;
mod scratch;

pub(crate) use few::{FewScratch, MAX_SWEEP_POINTS};
pub(crate) use perceptron::{LayerShape, Mlp};
pub(crate) use scratch::Scratch;
