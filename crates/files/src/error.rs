//! The errors of files: wrong input, as one line that names the file and the field, and output that
//! cannot be written.

use std::fmt::Display;
use std::io;
use std::path::{Path, PathBuf};

/// The `file` of an error in an argument of the command line.
pub const ARGUMENTS: &str = "arguments";

/// Wrong input: an error that the user can correct in a file or in an argument.
///
/// Displays as one line, `FILE: FIELD: found FOUND, expected EXPECTED`. The command line ends with
/// exit status 2 on this error.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {field}: found {found}, expected {expected}", shown(file))]
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
    /// that the message is one line. They become [`printable`], and a long field or value is cut.
    pub fn new(
        file: impl AsRef<Path>,
        field: impl Display,
        found: impl Display,
        expected: impl Display,
    ) -> Self {
        InputError {
            file: file.as_ref().to_owned(),
            field: cut(one_line(field), SHOWN_CHARACTERS),
            found: cut(one_line(found), SHOWN_CHARACTERS),
            expected: one_line(expected),
        }
    }
}

/// A file that cannot be written.
///
/// Its cause, if any, is the [`source`](std::error::Error::source) and no part of the message.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The path, or an input that the content is made of, is wrong.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The content cannot be made, or the system does not take it.
    #[error("cannot write {}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The system makes no file in a folder, for example since the disk is full.
    #[error("cannot write in {}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// The cause.
        source: io::Error,
    },
}

impl WriteError {
    /// The error of a file that cannot be written.
    pub fn of_file(path: impl AsRef<Path>, source: io::Error) -> Self {
        WriteError::File { path: path.as_ref().to_owned(), source }
    }

    /// The error of a folder in which no file can be written.
    pub fn of_folder(folder: impl AsRef<Path>, source: io::Error) -> Self {
        WriteError::Folder { folder: folder.as_ref().to_owned(), source }
    }

    /// The wrong input, if that is the error.
    pub fn input(&self) -> Option<&InputError> {
        match self {
            WriteError::Input(input) => Some(input),
            WriteError::File { .. } | WriteError::Folder { .. } => None,
        }
    }
}

fn one_line(text: impl Display) -> String {
    printable(&text.to_string().split_whitespace().collect::<Vec<_>>().join(" "))
}

/// The most characters of a field or of a value that a message shows.
const SHOWN_CHARACTERS: usize = 300;

/// The most characters of a path that a message shows. No system has files with longer paths than
/// 4096 bytes; a data set may name one.
const SHOWN_OF_PATH: usize = 1000;

/// A path for a message.
fn shown(file: &Path) -> String {
    cut(escaped(&file.to_string_lossy()), SHOWN_OF_PATH)
}

/// The first characters of a long text, and `…`.
fn cut(mut text: String, most: usize) -> String {
    if let Some((end, _)) = text.char_indices().nth(most) {
        text.truncate(end);
        text.push('…');
    }
    text
}

/// A text for the terminal.
///
/// Hidden characters are shown as their codes, for example `\u{1b}`, and a number of more than 24
/// digits with an exponent.
///
/// ```
/// assert_eq!(files::printable(&format!("red \u{1b}[31m, {} m", 1e300)), "red \\u{1b}[31m, 1e300 m");
/// ```
pub fn printable(text: &str) -> String {
    let text = escaped(text);
    let (mut out, mut rest) = (String::new(), text.as_str());
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        let after = |c: char| !c.is_ascii_digit() && c != '.';
        let end = rest[start..].find(after).map_or(rest.len(), |length| start + length);
        let end = start + rest[start..end].trim_end_matches('.').len();
        let (before, digits) = (&rest[..start], &rest[start..end]);
        out.push_str(before);
        match digits.parse::<f64>() {
            Ok(number) if number.is_finite() && digits.len() > LONGEST_NUMBER => {
                out.push_str(&format!("{number:e}"));
            }
            _ => out.push_str(digits),
        }
        rest = &rest[end..];
    }
    out + rest
}

/// The most characters of a number in decimal digits: a double of 17 digits below 1 has up to 23.
const LONGEST_NUMBER: usize = 24;

/// Whether a character has no shape of its own: a control character, which can move the cursor or
/// change the settings of a terminal, or a mark that turns the direction of writing.
pub fn is_hidden(c: char) -> bool {
    let turns = matches!(
        c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
    );
    c.is_control() || turns
}

/// The text with the codes of hidden characters in their place.
fn escaped(text: &str) -> String {
    let shown = |c: char| if is_hidden(c) { c.escape_unicode().to_string() } else { c.to_string() };
    text.chars().map(shown).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_one_line_without_control_characters_and_not_long() {
        let file = Path::new("a\u{1b}]0;x\u{7}.json");
        let found = format!("\u{1b}[31mred\n\u{9b}2J \u{202e}{}", "y".repeat(4000));
        let message = InputError::new(file, "/sdf\r/a", &found, "b\tc").to_string();
        assert!(message.starts_with("a\\u{1b}]0;x\\u{7}.json: /sdf /a: found \\u{1b}[31mred "));
        assert!(
            message.contains("\\u{9b}2J \\u{202e}yyy") && message.ends_with("y…, expected b c")
        );
        assert!(!message.chars().any(char::is_control) && message.len() < 500, "{message}");
    }

    #[test]
    fn numbers_are_short() {
        for value in [1e300, -1e300, 1e-300, 2.5, 1.0 / 3e4, f64::MAX] {
            let shown = printable(&format!("a {value}, b {value:.3}."));
            assert!(shown.len() < 64, "{shown}");
            let first = shown.trim_start_matches("a ").split(',').next().unwrap();
            assert_eq!(first.parse::<f64>().unwrap(), value);
        }
        let hash = "0123456789abcdef".repeat(3);
        assert_eq!(printable(&hash), hash);
        let found = InputError::new("a.json", "/sdf", glam::DVec3::splat(1e300), "b").found;
        assert_eq!(found, "[1e300, 1e300, 1e300]");
    }
}
