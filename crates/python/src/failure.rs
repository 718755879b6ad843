//! Errors: from Rust to exceptions, and exceptions of callbacks.

use std::sync::OnceLock;

use pyo3::create_exception;
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError, PyValueError};
use pyo3::prelude::*;

create_exception!(
    dsdf,
    InputError,
    PyValueError,
    "Wrong arguments or wrong input, in one line: the place, what was found and what was expected."
);

/// The exception of wrong input.
pub(crate) fn wrong_input(error: files::InputError) -> PyErr {
    of_anyhow(&error.into())
}

/// The exception of wrong input: `place` and `field` name it.
pub(crate) fn wrong(place: &str, field: &str, found: impl ToString, expected: &str) -> PyErr {
    wrong_input(files::InputError::new(place, field, found.to_string(), expected))
}

/// The exception of an error, by its exit status: `InputError` for 2, `KeyboardInterrupt` for 130,
/// else `RuntimeError`.
pub(crate) fn of_anyhow(error: &anyhow::Error) -> PyErr {
    let line = app::error::error_line(error);
    match app::error::exit_status(error) {
        2 => InputError::new_err(line),
        130 => PyKeyboardInterrupt::new_err(line),
        _ => PyRuntimeError::new_err(line),
    }
}

/// The first exception of the callbacks of one pass.
///
/// The trait of fields has no errors: after the first exception, callbacks are not called any more
/// and give NaN, which ends the pass.
#[derive(Default)]
pub(crate) struct Failure(OnceLock<PyErr>);

impl Failure {
    /// Whether a callback has raised an exception.
    pub(crate) fn is_set(&self) -> bool {
        self.0.get().is_some()
    }

    /// Keeps the exception if it is the first.
    pub(crate) fn keep(&self, error: PyErr) {
        // A second exception follows from the first, or is as good.
        let _ = self.0.set(error);
    }

    /// The exception, if there is one.
    pub(crate) fn into_result(self) -> PyResult<()> {
        self.0.into_inner().map_or(Ok(()), Err)
    }
}
