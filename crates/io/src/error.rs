//! Errors as a user meets them: one line, and an exit status.

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Wrong input: the file, the field in it, what was found and what was expected. Exit status 2.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {field}: found {found}, expected {expected}", file.display())]
pub struct InputError {
    /// The file (or folder) at fault.
    pub file: PathBuf,
    /// The place in the file: a key, a JSON pointer, a line.
    pub field: String,
    /// What stands there.
    pub found: String,
    /// What should stand there.
    pub expected: String,
}

impl InputError {
    /// An input error; line breaks in what was found are flattened, so that the message stays one
    /// line.
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
