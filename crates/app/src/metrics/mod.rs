//! How close pictures and surfaces are to the truth.

mod image;
mod surface;

pub use image::{mask_iou, psnr, ssim};
pub use surface::{Comparison, compare};
