//! Reading a sweep: one that is shipped with the command, or a file.

use std::path::{Path, PathBuf};

use crate::report::files::read_text;
use crate::report::sweep::Sweep;
use files::InputError;

/// The names of the sweeps that come with the workspace, in `xtask/sweeps`. They are read when they
/// are used, so that the package of this crate needs no file outside of it.
pub const SHIPPED: [&str; 9] = [
    "k-gamma",
    "high-gamma",
    "bare",
    "steps-epsilon",
    "steps-refined",
    "filters",
    "precision",
    "detail",
    "smoke",
];

/// The name of a shipped sweep unchanged, or the absolute path of a sweep file.
///
/// # Errors
/// If the current folder is unknown.
pub fn absolute(name: &str) -> std::io::Result<String> {
    if SHIPPED.contains(&name) {
        return Ok(name.to_owned());
    }
    Ok(std::path::absolute(name)?.to_string_lossy().into_owned())
}

impl Sweep {
    /// Reads a shipped sweep or a file. Returns it with its base folder: the paths in the file are
    /// relative to that folder.
    ///
    /// # Errors
    /// An [`InputError`] if the file cannot be read, or has a wrong field.
    pub fn load(name: &str) -> Result<(Sweep, PathBuf), InputError> {
        let (path, source) = source(name)?;
        let sweep: Sweep = toml::from_str(&source).map_err(|e| {
            let line = e.span().map_or(0, |span| source[..span.start].matches('\n').count() + 1);
            let message = e.message().replace('\n', " ");
            InputError::new(&path, format!("line {line}"), message, "a sweep (see docs/ablate.md)")
        })?;
        sweep.check(&path)?;
        Ok((sweep, path.parent().map(Path::to_owned).unwrap_or_default()))
    }
}

/// The text of the file of a sweep that comes with the workspace.
///
/// # Errors
/// If it cannot be read.
pub fn shipped(name: &str) -> Result<String, InputError> {
    source(name).map(|(_, text)| text)
}

/// The path and the text of a shipped sweep or a file.
fn source(name: &str) -> Result<(PathBuf, String), InputError> {
    let path = match SHIPPED.contains(&name) {
        true => crate::measure::workspace_root().join("xtask/sweeps").join(format!("{name}.toml")),
        false => PathBuf::from(name),
    };
    let source = read_text(&path).map_err(|e| {
        let names = SHIPPED.join(", ");
        InputError::new(&path, "sweep", e, format!("a TOML file, or one of {names}"))
    })?;
    Ok((path, source))
}
