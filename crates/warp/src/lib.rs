#![doc = include_str!("../README.md")]
#![allow(clippy::doc_markdown, reason = "the subscripts of formulas are no code")]

mod args;
mod density;
mod evaluate;
mod options;
mod projection;
mod ray;
mod top_k;
mod warp;

pub use args::{WarpArgs, WarpDefaults};
pub use density::{Motion, PublishedWeighting, Weighting};
pub use evaluate::{evaluate, evaluate_with_divergence};
pub use field;
pub use options::WarpOptions;
pub use projection::{Pinhole, Projection};
pub use ray::WarpedRay;
pub use warp::{SampleDivergence, Warp, WarpSample, WarpWithDivergence};
