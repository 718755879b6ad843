#![doc = include_str!("../README.md")]

mod architecture;
mod budget;
mod camera_alignment;
mod camera_corrections;
mod camera_matching;
mod camera_trial;
mod cameras;
pub mod checkpoint;
mod clock;
mod depth_search;
mod depths;
mod downscale;
mod error;
mod exposures;
mod fit;
mod lattice;
mod metrics;
mod metrics_file;
mod model;
mod model_background;
mod objective;
mod optimiser;
mod options;
mod photographs;
mod picture_file;
mod preview;
mod run_cameras;
mod run_file;
mod run_folder;
mod run_json;
mod session;
mod solid;
mod split;
mod step;
mod streams;
mod survey;

pub use budget::Budget;
pub use camera_alignment::align;
pub use camera_corrections::Corrections;
pub use clock::Clock;
pub use error::FitError;
pub use exposures::{RunExposure, RunExposures, match_exposures};
pub use fit::Fit;
pub use loss::photometry::{
    BackgroundChoice, BackgroundKind, ExposureChoice, ExposureModel, Limit, MaskChoice, MaskUse,
    check_masks,
};
pub use loss::{Observer, Stage, Workspace};
pub use metrics::{Metrics, StepMetrics};
pub use model::Model;
pub use model_background::ModelBackground;
pub use multiview::calibrate::{CameraDecision, RefineCameras};
pub use multiview::stereo::StereoChoice;
pub use options::{FitOptions, FitWarp};
pub use photographs::Photographs;
pub use preview::write_preview;
pub use run_cameras::{RunCamera, RunCameras};
pub use run_file::RunFile;
pub use run_folder::RunFolder;
pub use sdf_nn::grids::GridLevels;
pub use session::Session;
pub use solid::Solid;
pub use split::Split;
