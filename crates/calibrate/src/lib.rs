#![doc = include_str!("../README.md")]

mod calibration;
mod freedom;
mod gauge;
mod units;

pub use calibration::{Calibration, CalibrationError, Correction};
pub use freedom::Freedom;

#[cfg(test)]
mod tests;
