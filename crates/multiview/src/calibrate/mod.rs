//! Corrections of cameras, by keypoint matches or by the adjoints of their rays.

mod bundle;
mod calibration;
mod choice;
mod freedom;
mod gauge;
mod matching;
mod median;
mod solve;
mod trial;
mod units;

pub use bundle::{Observation, Residuals, Track};
pub use calibration::{Calibration, CalibrationError, Correction};
pub use choice::{CameraDecision, RefineCameras};
pub use freedom::Freedom;
pub use matching::{Matching, off_views};
pub use trial::Trial;

#[cfg(test)]
mod tests;
