#![doc = include_str!("../README.md")]

mod cloud;
mod image;
#[cfg(test)]
mod image_tests;
mod nearest;
mod sample;
mod shading;
mod ssim;
mod surface;

pub use cloud::{CloudComparison, Distances, compare_to_cloud, points_drawn};
pub use image::{mask_iou, psnr, psnr_where};
pub use sample::{SurfacePoint, sample_surface};
pub use shading::Normals;
pub use ssim::ssim;
pub use surface::{Comparison, compare, compare_to_field, distances_to_surface};
