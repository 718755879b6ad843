#![doc = include_str!("../README.md")]

mod grids;

pub use grids::{FEATURES, Grids, MOST_CELLS, MOST_LEVELS};
