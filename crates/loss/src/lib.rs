#![doc = include_str!("../README.md")]
#![allow(clippy::doc_markdown, reason = "the subscripts of formulas are no code")]
#![allow(missing_debug_implementations, reason = "their types hold closures and fields")]

mod batch;
mod bending;
mod carve;
mod eikonal;
mod gradient;
pub mod opacity;
mod part;
pub mod photometry;
pub mod schedule;
mod sharp;
mod soft;
mod sums;

pub use batch::{Batch, BatchStats};
pub use gradient::{Gradient, ROUND, gradient};
pub use sums::{Observer, Stage, Workspace};

#[cfg(test)]
mod gradient_tests;
#[cfg(test)]
mod test_model;
