//! JSON files of a run folder.

use std::path::Path;

use serde::{Serialize, de::DeserializeOwned};

use files::{InputError, WriteError, atomic_write};

/// Writes a value to a file of a run folder.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn save(path: &Path, value: &impl Serialize) -> Result<(), WriteError> {
    atomic_write(path, |out| {
        let text = serde_json::to_string_pretty(value)?;
        out.write_all(text.as_bytes())
    })
}

/// Reads a file of a run folder; `None` if there is none. `content` names its content in
/// messages, in the plural.
///
/// # Errors
/// If the file is there and cannot be read, or has a wrong entry.
pub(crate) fn load<T: DeserializeOwned>(
    path: &Path,
    content: &str,
) -> Result<Option<T>, InputError> {
    if !path.exists() {
        return Ok(None);
    }
    let text = files::read_text(path, content, &format!("the {content} of a run"))?;
    let value = serde_json::from_str(&text).map_err(|e| wrong(path, content, &e))?;
    Ok(Some(value))
}

/// The error of a file whose content no fit wrote.
pub(crate) fn wrong(path: &Path, content: &str, found: &dyn std::fmt::Display) -> InputError {
    let expected = format!("the {content} that a fit wrote");
    InputError::new(path, content, found, expected)
}
