#![doc = include_str!("../README.md")]

pub mod calibrate;
pub mod stereo;
