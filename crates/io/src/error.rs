//! The error of wrong input: one line that names the file and the field.

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Wrong input: an error that the user can correct in a file or in an argument.
///
/// Displays as one line, `FILE: FIELD: found FOUND, expected EXPECTED`. The command line ends with
/// exit status 2 on this error.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {field}: found {found}, expected {expected}", file.display())]
pub struct InputError {
    /// The file or folder with the error, or `arguments` for the command line.
    pub file: PathBuf,
    /// The place in the file: a key, a JSON pointer, a line.
    pub field: String,
    /// The value at that place.
    pub found: String,
    /// A description of the values that are allowed there.
    pub expected: String,
}

impl InputError {
    /// An input error from its four parts.
    ///
    /// Line breaks and runs of spaces in `field`, `found` and `expected` become single spaces, so
    /// that the message is one line.
    pub fn new(
        file: impl AsRef<Path>,
        field: impl Display,
        found: impl Display,
        expected: impl Display,
    ) -> Self {
        InputError {
            file: file.as_ref().to_owned(),
            field: one_line(field),
            found: one_line(found),
            expected: one_line(expected),
        }
    }
}

fn one_line(text: impl Display) -> String {
    text.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}
