//! The error of a fit.

use files::{InputError, WriteError};
use multiview::calibrate::CalibrationError;
use optim::OptimError;
use render::InvalidField;

/// A fit that cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// An option, a photograph or a file of the run is wrong input.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The field gives a NaN or an infinity along a ray.
    #[error(transparent)]
    Field(#[from] InvalidField),
    /// A gradient by parameters or exposures is not finite.
    #[error(transparent)]
    Gradient(#[from] OptimError),
    /// A gradient by cameras is not finite.
    #[error(transparent)]
    Cameras(#[from] CalibrationError),
    /// The field or the radiance has no form as a model file.
    #[error(transparent)]
    Model(#[from] sdf_nn::ModelError),
    /// The background has no form as a model file.
    #[error(transparent)]
    Background(#[from] sdf_nn::background::FileError),
    /// The state has no form as a checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] safetensors::SafeTensorError),
    /// The options have no TOML form.
    #[error(transparent)]
    Options(#[from] toml::ser::Error),
}

impl FitError {
    /// The wrong input, if that is the error.
    pub fn input(&self) -> Option<&InputError> {
        match self {
            FitError::Input(input) => Some(input),
            FitError::Write(error) => error.input(),
            _ => None,
        }
    }
}
