//! The error of wrong input: one line that names the file and the field.

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Wrong input: an error that the user can correct in a file or in an argument.
///
/// Displays as one line, `FILE: FIELD: found FOUND, expected EXPECTED`. The command line ends with
/// exit status 2 on this error.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {field}: found {found}, expected {expected}", printable(&file.to_string_lossy()))]
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
    /// that the message is one line. Control characters are shown as their codes, and a long field
    /// or value is cut.
    pub fn new(
        file: impl AsRef<Path>,
        field: impl Display,
        found: impl Display,
        expected: impl Display,
    ) -> Self {
        InputError {
            file: file.as_ref().to_owned(),
            field: cut(one_line(field)),
            found: cut(one_line(found)),
            expected: one_line(expected),
        }
    }
}

fn one_line(text: impl Display) -> String {
    printable(&text.to_string().split_whitespace().collect::<Vec<_>>().join(" "))
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

/// A text of a file for the terminal: control characters, which could move the cursor or change
/// settings, and marks that turn the direction of writing are shown as their codes: `\u{1b}`.
pub fn printable(text: &str) -> String {
    let is_hidden = |c: char| {
        c.is_control()
            || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    let shown = |c: char| if is_hidden(c) { c.escape_unicode().to_string() } else { c.to_string() };
    text.chars().map(shown).collect()
}

/// A number for a message or a table: digits, or with an exponent if it is very large or small.
///
/// ```
/// assert_eq!(io::number(0.25), "0.25");
/// assert_eq!(io::number(-1e300), "-1e300");
/// ```
pub fn number(value: f64) -> String {
    let magnitude = value.abs();
    if value == 0.0 || (1e-5..1e16).contains(&magnitude) || !value.is_finite() {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_one_line_without_control_characters_and_not_long() {
        let file = Path::new("a\u{1b}]0;x\u{7}.json");
        let found = format!("\u{1b}[31mred\n\u{9b}2J \u{202e}{}", "9".repeat(4000));
        let message = InputError::new(file, "/sdf\r/a", &found, "b\tc").to_string();
        assert!(message.starts_with("a\\u{1b}]0;x\\u{7}.json: /sdf /a: found \\u{1b}[31mred "));
        assert!(
            message.contains("\\u{9b}2J \\u{202e}999") && message.ends_with("9…, expected b c")
        );
        assert!(!message.chars().any(char::is_control) && message.len() < 500, "{message}");
    }

    #[test]
    fn numbers_are_short() {
        for (value, shown) in [(0.0, "0"), (1e300, "1e300"), (-2.5, "-2.5"), (3e-9, "3e-9")] {
            assert_eq!(number(value), shown);
        }
        assert_eq!(number(f64::NAN), "NaN");
        assert_eq!(number(f64::NEG_INFINITY), "-inf");
    }
}
