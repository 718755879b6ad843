//! Trainable features on grids of several resolutions: hash-grid features and splines.

mod grid_levels;
mod hashed;
mod near;
mod splines;
#[cfg(test)]
mod splines_tests;
mod support;
mod taps;

pub use grid_levels::GridLevels;
pub use hashed::{FEATURES, HashGrid, MOST_CELLS, MOST_LEVELS};
pub use splines::{Degree, MOST_COEFFICIENTS, MOST_FEATURES, SplineSize, Splines};
pub use taps::{Jet, PADDING};
