#![doc = include_str!("../README.md")]

mod alignment;
mod budget;
mod cameras;
mod depths;
mod downscale;
mod examine;
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
pub use calibrate::{CameraDecision, RefineCameras};
pub use examine::{examine, modelled};
pub use exposure::{RunExposure, RunExposures, match_exposures};
pub use grids::GridLevels;
pub use iteration::Metrics;
pub use metrics_file::MetricsFile;
pub use model::Model;
pub use model_background::ModelBackground;
pub use objective::{Observer, Stage};
pub use options::FitOptions;
pub use photometry::{
    BackgroundChoice, BackgroundKind, ExposureChoice, ExposureModel, Limit, MaskChoice, MaskUse,
    check_masks,
};
pub use run::Fit;
pub use run_cameras::{RunCamera, RunCameras};
pub use run_file::RunFile;
pub use solid::Solid;
pub use split::Split;
pub use stereo::StereoChoice;
