#![doc = include_str!("../README.md")]

mod calibration;
mod choice;
mod freedom;
mod gauge;
mod trial;
mod units;

pub use calibration::{Calibration, CalibrationError, Correction};
pub use choice::{CameraDecision, RefineCameras};
pub use freedom::Freedom;
pub use trial::Trial;

#[cfg(test)]
mod tests;
