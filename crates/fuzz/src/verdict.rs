//! The property that every reader must have.

use std::path::Path;

use app::error::input_error;

/// The most characters of a message, beyond the path of the folder.
const MAX_MESSAGE_CHARACTERS: usize = 2500;

/// The outcome of a case.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The file is valid, or its harm does not matter.
    Accepted,
    /// The file is refused with one line.
    Refused,
    /// The message is no good line.
    Wrong(String),
}

/// Judges the result of a reader.
///
/// An error must be wrong input, in one printable line of ordinary length that names a file or
/// folder of `folder`.
pub(crate) fn judge(folder: &Path, result: &anyhow::Result<()>) -> Verdict {
    let Err(error) = result else { return Verdict::Accepted };
    let of_sweep = error.downcast_ref::<sweep::Error>().and_then(sweep::Error::input);
    if input_error(error).or(of_sweep).is_none() {
        return Verdict::Wrong(format!("no input error: {error:#}"));
    }
    judge_line(folder, &error.to_string())
}

/// Judges a message: one printable line that names a file. A case may name a file elsewhere, by an
/// absolute path.
pub(crate) fn judge_line(folder: &Path, message: &str) -> Verdict {
    let folder = folder.display().to_string();
    let length = message.replace(&folder, "").chars().count();
    if let Some(odd) = message.chars().find(|c| c.is_control()) {
        Verdict::Wrong(format!("control character {odd:?} in a message: {message}"))
    } else if length > MAX_MESSAGE_CHARACTERS {
        let start: String = message.chars().take(200).collect();
        Verdict::Wrong(format!("a message of {length} characters: {start}"))
    } else if !message.contains(&folder) && !message.starts_with('/') {
        Verdict::Wrong(format!("no file in a message: {message}"))
    } else {
        Verdict::Refused
    }
}

#[cfg(test)]
mod tests {
    use files::InputError;

    use super::*;

    #[test]
    fn only_a_line_that_names_a_file_is_a_refusal() {
        let folder = Path::new("some/case");
        let error = |file: &str, found: &str| {
            let error =
                InputError { found: found.to_owned(), ..InputError::new(file, "a", "", "b") };
            judge(folder, &Err(error.into()))
        };
        assert_eq!(judge(folder, &Ok(())), Verdict::Accepted);
        assert_eq!(error("some/case/a.json", "3"), Verdict::Refused);
        for (file, found) in [
            ("elsewhere", "3"),
            ("some/case/a.json", "\u{1b}[31m"),
            ("some/case/a.json", "two\nlines"),
            ("some/case/a.json", &"3".repeat(3000)),
        ] {
            assert!(matches!(error(file, found), Verdict::Wrong(_)), "{file}: {found}");
        }
        let other = judge(folder, &Err(anyhow::anyhow!("some/case/a.json: broken")));
        assert!(matches!(other, Verdict::Wrong(_)), "{other:?}");
    }
}
