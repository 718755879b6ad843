//! Wrong input, which ends the command with one line and exit status 2.

use std::fmt::Display;
use std::path::Path;

/// Wrong input: the file, the field in it, the value found and the value expected.
#[derive(Debug, thiserror::Error)]
#[error("{file}: {field}: found {found}, expected {expected}")]
pub struct Refusal {
    file: String,
    field: String,
    found: String,
    expected: String,
}

impl Refusal {
    /// A refusal from another program's message. If the message names an expected value, that one
    /// is taken in place of `expected`.
    pub fn from_message(file: &Path, field: impl Display, message: &str, expected: &str) -> Self {
        let (found, expected) = message.rsplit_once(", expected ").unwrap_or((message, expected));
        Self::new(file, field, found, expected)
    }

    /// A refusal in one line: line breaks in the texts become spaces.
    pub fn new(
        file: &Path,
        field: impl Display,
        found: impl Display,
        expected: impl Display,
    ) -> Self {
        let line =
            |text: &dyn Display| text.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        let file = file.display().to_string();
        Refusal { file, field: line(&field), found: line(&found), expected: line(&expected) }
    }
}
