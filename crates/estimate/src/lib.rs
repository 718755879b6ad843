//! Estimators: radiance of film samples, and its derivatives forward (to images) and in reverse (to
//! parameters).

mod adjoints;
mod band;
mod contour;
mod convolution;
mod difference;
mod estimator;
mod image;
mod invalid;
mod lines;
mod near;
mod neighbours;
mod parallel;
mod pixels;
mod primary;
mod record;
mod refined;
mod surface;
mod target;
mod warped;
mod warping;

pub use adjoints::Adjoints;
pub use band::Band;
pub use contour::Contour;
pub use convolution::Convolution;
pub use difference::finite_difference;
pub use estimator::{Estimator, Filter, Method, Pixel, Survey};
pub use image::{Derivative, Direction, Sampling, differentiate, random_unit};
pub use invalid::InvalidField;
pub use near::{Doubt, near_silhouettes};
pub use parallel::ordered_sum;
pub use pixels::check_valid;
pub use pixels::{Render, render};
pub use primary::{Primary, Sample, Setup};
pub use record::{Area, AreaWarp, Border, Pass, Record, Silhouettes};
pub use refined::Refined;
pub use surface::SurfaceAdjoint;
pub use target::{TargetGradient, target_gradient};
pub use warped::{Control, FILTER_DEVIATION, WarpedArea};
pub use warping::Warped;
