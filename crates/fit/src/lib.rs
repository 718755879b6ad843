#![doc = include_str!("../README.md")]

mod background;
mod checkpoint;
mod downscale;
mod iteration;
mod loss;
mod masks;
mod model;
mod model_background;
mod options;
mod preview;
mod pyramid;
mod run;
mod run_file;
mod schedule;
mod solid;
mod step;
mod turntable;

pub use downscale::Limit;
pub use iteration::Metrics;
pub use masks::{MaskChoice, MaskUse};
pub use model::Model;
pub use model_background::{BackgroundChoice, BackgroundKind, ModelBackground};
pub use options::{DEFAULT_ITERATIONS, FitOptions, parse_bounds, parse_duration};
pub use preview::{difference, normal_map, write_preview};
pub use run::Fit;
pub use run_file::RunFile;
pub use solid::Solid;
pub use turntable::{around, turntable, upwards};
