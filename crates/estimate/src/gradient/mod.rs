//! Derivative images, gradients of image losses, and finite differences of images.

mod derivative_image;
mod differences;
mod replicates;
mod target_gradient;

pub use derivative_image::{Derivative, Direction, differentiate, random_unit};
pub use differences::{Difference, finite_difference};
pub use replicates::Sampling;
pub use target_gradient::{TargetGradient, target_gradient};
