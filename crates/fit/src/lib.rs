#![doc = include_str!("../README.md")]
#![allow(missing_debug_implementations, reason = "their types hold closures and fields")]

mod alignment;
mod budget;
mod cameras;
pub mod checkpoint;
mod depths;
mod downscale;
mod exposure;
mod grid_levels;
mod iteration;
mod metrics_file;
mod model;
mod model_background;
mod options;
mod run;
mod run_cameras;
mod run_file;
mod solid;
mod split;

pub use alignment::align;
pub use budget::Budget;
pub use exposure::{RunExposure, RunExposures, match_exposures};
pub use iteration::Metrics;
pub use loss::photometry::{
    BackgroundChoice, BackgroundKind, ExposureChoice, ExposureModel, Limit, MaskChoice, MaskUse,
    check_masks,
};
pub use loss::{Observer, Stage};
pub use metrics_file::MetricsFile;
pub use model::Model;
pub use model_background::ModelBackground;
pub use multiview::calibrate::{CameraDecision, RefineCameras};
pub use multiview::stereo::StereoChoice;
pub use options::{FitOptions, FitWarp};
pub use run::{Fit, write_preview};
pub use run_cameras::{RunCamera, RunCameras};
pub use run_file::RunFile;
pub use sdf_nn::grids::GridLevels;
pub use solid::Solid;
pub use split::Split;
