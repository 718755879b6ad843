//! The errors of a sweep.

use std::io;
use std::path::Path;

use files::InputError;

/// A command of the measured program that failed: in a cell of a sweep, it is the cell's result.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{reason}")]
pub struct ProcessFailure {
    /// `failed`, `time` or `memory`.
    pub status: &'static str,
    /// The reason, from the program's messages.
    pub reason: String,
}

impl ProcessFailure {
    /// The failure of a program that ran longer than `limit` seconds.
    pub(crate) fn time(limit: f64) -> Self {
        ProcessFailure { status: "time", reason: format!("{limit} s are over") }
    }

    pub(crate) fn failed(reason: String) -> Self {
        ProcessFailure { status: "failed", reason }
    }
}

/// A sweep or a measurement that cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The sweep, a folder or an argument is wrong input.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A command of the measured program failed.
    #[error(transparent)]
    Process(#[from] ProcessFailure),
    /// A fault of the machine, or an interruption by the user, ended a program.
    #[error("{0}")]
    Fault(String),
    /// A file or a report is not of the expected form.
    #[error("{0}")]
    Content(String),
    /// The system refuses an action, which the text names, often by a path alone.
    #[error("{action}")]
    Action {
        /// The action.
        action: String,
        /// The reason of the system.
        source: io::Error,
    },
    /// The system refuses something.
    #[error(transparent)]
    System(#[from] io::Error),
}

impl Error {
    /// The error of an action that the system refuses.
    pub(crate) fn action(action: impl Into<String>) -> impl FnOnce(io::Error) -> Self {
        let action = action.into();
        |source| Error::Action { action, source }
    }

    /// The error of a file that the system does not read or write.
    pub(crate) fn file(path: &Path) -> impl FnOnce(io::Error) -> Self + use<> {
        Self::action(path.display().to_string())
    }

    /// The error of content with this message.
    pub(crate) fn content(message: impl ToString) -> Self {
        Error::Content(message.to_string())
    }

    /// The error of a part that a file or a report lacks.
    pub(crate) fn lacks(part: &str) -> impl FnOnce() -> Self + use<'_> {
        move || Error::content(part)
    }

    /// The error and its cause.
    pub(crate) fn with_cause(&self) -> String {
        match self {
            Error::Action { action, source } => format!("{action}: {source}"),
            other => other.to_string(),
        }
    }

    /// The wrong input, if that is the error.
    pub fn input(&self) -> Option<&InputError> {
        match self {
            Error::Input(input) => Some(input),
            _ => None,
        }
    }

    /// Whether it is no failure of a cell itself: a fault, or a file that cannot be read or
    /// written. A missing file is the cell's own failure.
    pub(crate) fn is_fault(&self) -> bool {
        match self {
            Error::Fault(_) => true,
            Error::Action { source, .. } | Error::System(source) => {
                source.kind() != io::ErrorKind::NotFound
            }
            Error::Input(_) | Error::Process(_) | Error::Content(_) => false,
        }
    }
}
