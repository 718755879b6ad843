//! Input that is refused: one line, exit status 2.

use std::fmt::Display;
use std::path::Path;

/// What was wrong with a file or an argument.
#[derive(Debug, thiserror::Error)]
#[error("{file}: {field}: found {found}, expected {expected}")]
pub struct Refusal {
    file: String,
    field: String,
    found: String,
    expected: String,
}

impl Refusal {
    /// Of what another program said: its own "expected", or else this one.
    pub(super) fn of(file: &Path, field: impl Display, said: &str, expected: &str) -> Self {
        let (found, expected) = said.rsplit_once(", expected ").unwrap_or((said, expected));
        Self::new(file, field, found, expected)
    }

    pub(super) fn new(
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
