//! The samples of an estimator over a batch of pixels, and their reverse mode.

mod adjoints;
mod area;
mod batch;
mod border;
mod cameras;
mod film_line;
mod film_warp;
mod ordered_sum;
mod parts;
mod pass;
mod silhouettes;
mod smooth_part;
mod surface;

pub use adjoints::{Adjoints, PixelAdjoint, PointAdjoint};
pub use area::{Area, AreaWarp, PixelWeight, WarpedSample};
pub use batch::Record;
pub use border::{Border, BorderSample};
pub use cameras::CameraAdjoints;
pub use film_line::{FilmLine, SegmentEnd};
pub use film_warp::{
    FilmWarp, FilmWarpWithDivergence, chart, warp_samples, warp_samples_with_divergence,
};
pub use ordered_sum::ordered_sum;
pub use pass::Pass;
pub use silhouettes::{SilhouettePoint, Silhouettes};
pub use smooth_part::{Stratification, add_smooth_part};
pub use surface::{HitBar, SurfaceCoefficients, surface_vjp};
