#![doc = include_str!("../README.md")]
#![allow(clippy::doc_markdown, reason = "the subscripts of formulas are no code")]

mod bending;
mod carve;
mod coverage;
mod drawn;
mod eikonal;
mod objective;
pub mod opacity;
mod patches;
pub mod photometry;
mod regularisers;
mod reversed;
pub mod schedule;
mod sharp;
mod soft;
mod stats;
mod sums;
mod total;
mod workspace;

pub use drawn::{ROUND, balanced};
pub use objective::{Objective, Patches, Regulariser, Surface, Targets, Wanted};
pub use stats::BatchStats;
pub use total::{Gradient, gradient};
pub use workspace::{Observer, Stage, Workspace};

#[cfg(test)]
mod test_model;
