//! Reconstruction: from posed photographs to a signed distance network and a radiance head.

mod checkpoint;
mod loss;
mod model;
mod options;
mod preview;
mod pyramid;
mod run;
mod schedule;
mod step;
pub mod turntable;

pub use model::{Model, RunFile};
pub use options::{DEFAULT_ITERATIONS, FitOptions};
pub use options::{parse_bounds, parse_duration};
pub use preview::{difference, normal_map, write_preview};
pub use run::{Fit, Metrics, setup};
