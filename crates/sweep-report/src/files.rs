//! Reading and replacing whole files.

use std::path::Path;

use anyhow::Context;

use crate::refusal::Refusal;

/// Replaces a file whole: a reader sees the old content or the new one, also after a crash of this
/// process. The content goes to a file with the ending `.part` first.
///
/// # Errors
/// If the folder or the file cannot be written.
pub fn write_whole(path: &Path, content: impl AsRef<[u8]>) -> anyhow::Result<()> {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    std::fs::write(&part, content).with_context(|| path.display().to_string())?;
    std::fs::rename(&part, path).with_context(|| path.display().to_string())
}

/// The text of a file, or `None` if there is no such file.
///
/// # Errors
/// A [`Refusal`] if the file is there and cannot be read as text.
pub fn read_if_present(path: &Path) -> Result<Option<String>, Refusal> {
    match std::fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(Refusal::new(path, "file", error, "a file to read")),
    }
}
