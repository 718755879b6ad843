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

    /// A refusal in one line: line breaks in the texts become spaces, other control characters are
    /// shown as their codes, and a long field or value is cut.
    pub fn new(
        file: &Path,
        field: impl Display,
        found: impl Display,
        expected: impl Display,
    ) -> Self {
        let line = |text: &dyn Display| {
            printable(&text.to_string().split_whitespace().collect::<Vec<_>>().join(" "))
        };
        Refusal {
            file: printable(&file.to_string_lossy()),
            field: cut(line(&field)),
            found: cut(line(&found)),
            expected: line(&expected),
        }
    }
}

/// A text of a file for the terminal: control characters are shown as their codes.
fn printable(text: &str) -> String {
    let shown = |c: char| if c.is_control() { c.escape_unicode().to_string() } else { c.into() };
    text.chars().map(shown).collect()
}

/// The most characters of a field or of a value that a message shows.
const SHOWN_CHARACTERS: usize = 300;

/// The first characters of a long text, and `…`.
fn cut(mut text: String) -> String {
    if let Some((end, _)) = text.char_indices().nth(SHOWN_CHARACTERS) {
        text.truncate(end);
        text.push('…');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_one_line_without_control_characters_and_not_long() {
        let found = format!("\u{1b}[31mred\n{}", "9".repeat(4000));
        let message = Refusal::new(Path::new("a\u{7}.toml"), "x", found, "b").to_string();
        assert!(message.starts_with("a\\u{7}.toml: x: found \\u{1b}[31mred 99"), "{message}");
        assert!(message.ends_with("9…, expected b") && message.len() < 400, "{message}");
    }
}
