#![doc = include_str!("../README.md")]

mod accuracy;
mod exposure;
mod overlay;
mod report;
mod surface;
#[cfg(test)]
mod tests;
mod text;
mod verdict;

pub use accuracy::sampled_psnr;
pub use exposure::{Exposure, ExposureSource, exposure_spread, exposures_differ};
pub use overlay::overlay;
pub use report::{Report, inspect};
pub use surface::{SurfaceShares, surface_shares};
pub use verdict::{Evidence, Fault, Verdict};
