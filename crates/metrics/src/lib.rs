//! How close pictures and surfaces are to the truth.

mod image;
mod surface;
mod tree;

pub use image::{mask_iou, psnr, ssim};
pub use surface::{Comparison, SurfacePoint, compare, compare_to_field, sample_surface};
