#![doc = include_str!("../README.md")]
#![allow(clippy::doc_markdown, reason = "the subscripts of formulas are no code")]

mod band;
mod contour;
mod convolution;
mod crossing;
mod discontinuity;
mod estimator;
mod gaussian_samples;
pub mod gradient;
mod interior;
mod options;
pub mod record;
mod refined;
mod registry;
mod silhouette_margin;
mod warped;

pub use band::Band;
pub use contour::Contour;
pub use convolution::Convolution;
pub use discontinuity::Discontinuity;
pub use estimator::{
    Batch, Estimator, FILTER_DEVIATION, Filter, SampleCounts, SilhouetteMask, Terms,
};
pub use gaussian_samples::gaussian_samples;
pub use interior::Interior;
pub use options::{Baseline, EstimatorOptions};
pub use refined::Refined;
pub use registry::{Constructor, Entry, EstimatorPrecision, Registry};
pub use silhouette_margin::{SilhouetteMargin, near_silhouettes};
pub use warped::WarpedArea;
