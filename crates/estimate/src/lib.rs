#![doc = include_str!("../README.md")]

mod band;
mod contour;
mod convolution;
mod derivative_image;
mod differences;
mod estimator;
mod film_line;
mod gaussian_samples;
mod interior;
mod options;
mod refined;
mod registry;
mod replicates;
mod silhouette_margin;
mod smooth_part;
mod target_gradient;
mod warped;

pub use band::Band;
pub use contour::Contour;
pub use convolution::Convolution;
pub use derivative_image::{Derivative, Direction, differentiate, random_unit};
pub use differences::finite_difference;
pub use estimator::{
    Batch, Estimator, FILTER_DEVIATION, Filter, SampleCounts, SilhouetteMask, Terms,
};
pub use interior::Interior;
pub use options::{Baseline, EstimatorOptions};
pub use record;
pub use refined::Refined;
pub use registry::{Constructor, Entry, EstimatorPrecision, Registry};
pub use replicates::Sampling;
pub use silhouette_margin::{SilhouetteMargin, near_silhouettes};
pub use target_gradient::{TargetGradient, target_gradient};
pub use warped::WarpedArea;
