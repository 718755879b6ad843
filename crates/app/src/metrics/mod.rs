//! How close pictures and surfaces are to the truth.

mod image;

pub use image::{mask_iou, psnr, ssim};
