#![doc = include_str!("../README.md")]

mod direction;
mod preview;
mod turntable;

pub use direction::{named, snapped};
pub use preview::{comparison, difference, write_preview};
pub use turntable::{around, turntable, upwards};
