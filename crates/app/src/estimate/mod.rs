//! Estimators: radiance of film samples, and its derivatives forward (to images) and in reverse (to parameters).

mod image;
mod parallel;
mod pixels;
mod primary;
mod surface;
mod target;
mod warping;

pub use image::{Derivative, Direction, Estimator, Sampling, differentiate};
pub use parallel::ordered_sum;
pub(crate) use pixels::check_valid;
pub use pixels::{Render, render};
pub use primary::{Primary, Sample, Setup};
pub use surface::SurfaceAdjoint;
pub use target::{TargetGradient, target_gradient};
pub use warping::{Adjoints, Warped};
