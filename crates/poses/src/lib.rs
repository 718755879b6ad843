#![doc = include_str!("../README.md")]

mod advice;
mod commands;
mod error;
mod output;
mod photographs;
mod program;
mod result;
mod run;
mod state;
mod step;

pub use advice::{FEW_REGISTERED, remedies};
pub use commands::{CameraChoice, CameraModel, Guided, Mapper, Matching, Options};
pub use error::Error;
pub use photographs::Photographs;
pub use program::Program;
pub use result::{Camera, Poses};
pub use run::{Event, Job, run};
pub use step::Step;
