//! The error of a search for poses.

use std::io;

use files::{InputError, WriteError};

/// Poses that cannot be found.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The photographs, the folder or the options are wrong input.
    #[error(transparent)]
    Input(#[from] InputError),
    /// COLMAP is missing, is too old, or fails. One line says which, and the remedy.
    #[error("{0}")]
    Colmap(String),
    /// COLMAP finds no pose. One line has the remedies.
    #[error("{0}")]
    NoPose(String),
    /// A file of the data set cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The system refuses an action, for example the start of a process.
    #[error("cannot {action}")]
    System {
        /// The action.
        action: String,
        /// The reason of the system.
        source: io::Error,
    },
}

impl Error {
    /// The error of an action that the system refuses.
    pub(crate) fn system(action: impl Into<String>) -> impl FnOnce(io::Error) -> Self {
        let action = action.into();
        |source| Error::System { action, source }
    }

    /// The wrong input, if that is the error.
    pub fn input(&self) -> Option<&InputError> {
        match self {
            Error::Input(input) => Some(input),
            Error::Write(error) => error.input(),
            Error::Colmap(_) | Error::NoPose(_) | Error::System { .. } => None,
        }
    }
}
