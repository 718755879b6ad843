//! Trainable features on grids of several resolutions: hash-grid features and splines.

mod adjoints;
mod grid_levels;
mod hashed;
mod jet;
mod near;
mod splines;
#[cfg(test)]
mod splines_tests;
mod support;
mod taps;

pub use grid_levels::GridLevels;
pub use hashed::{FEATURES, HashGrid, MOST_CELLS, MOST_LEVELS};
pub use jet::Jet;
pub use splines::{Degree, MOST_COEFFICIENTS, MOST_FEATURES, SplineSize, Splines};
pub use taps::PADDING;

pub(crate) use adjoints::Bars;
pub(crate) use taps::{Features, Points};
