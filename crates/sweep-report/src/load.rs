//! Reading a sweep: one that is shipped with the command, or a file.

use std::path::{Path, PathBuf};

use crate::files::read_text;
use crate::refusal::Refusal;
use crate::sweep::Sweep;

/// The sweeps that come with the command: their names and the contents of their files.
pub const SHIPPED: [(&str, &str); 9] = [
    ("k-gamma", include_str!("../../../xtask/sweeps/k-gamma.toml")),
    ("high-gamma", include_str!("../../../xtask/sweeps/high-gamma.toml")),
    ("bare", include_str!("../../../xtask/sweeps/bare.toml")),
    ("steps-epsilon", include_str!("../../../xtask/sweeps/steps-epsilon.toml")),
    ("steps-refined", include_str!("../../../xtask/sweeps/steps-refined.toml")),
    ("filters", include_str!("../../../xtask/sweeps/filters.toml")),
    ("precision", include_str!("../../../xtask/sweeps/precision.toml")),
    ("detail", include_str!("../../../xtask/sweeps/detail.toml")),
    ("smoke", include_str!("../../../xtask/sweeps/smoke.toml")),
];

/// The name of a shipped sweep unchanged, or the absolute path of a sweep file.
///
/// # Errors
/// If the current folder is unknown.
pub fn absolute(name: &str) -> std::io::Result<String> {
    if SHIPPED.iter().any(|(known, _)| *known == name) {
        return Ok(name.to_owned());
    }
    Ok(std::path::absolute(name)?.to_string_lossy().into_owned())
}

impl Sweep {
    /// Reads a shipped sweep or a file. Returns it with its base folder: the paths in the file are
    /// relative to that folder.
    ///
    /// # Errors
    /// A [`Refusal`] if the file cannot be read, or has a wrong field.
    pub fn load(name: &str) -> Result<(Sweep, PathBuf), Refusal> {
        let (path, source) = source(name)?;
        let sweep: Sweep = toml::from_str(&source).map_err(|e| {
            let line = e.span().map_or(0, |span| source[..span.start].matches('\n').count() + 1);
            let message = e.message().replace('\n', " ");
            Refusal::new(&path, format!("line {line}"), message, "a sweep (see docs/ablate.md)")
        })?;
        sweep.check(&path)?;
        Ok((sweep, path.parent().map(Path::to_owned).unwrap_or_default()))
    }
}

/// The path and the text of a shipped sweep or a file.
fn source(name: &str) -> Result<(PathBuf, String), Refusal> {
    if let Some((_, source)) = SHIPPED.iter().find(|(known, _)| *known == name) {
        let folder = measure::dsdf::root().join("xtask/sweeps");
        return Ok((folder.join(format!("{name}.toml")), (*source).to_owned()));
    }
    let path = PathBuf::from(name);
    let source = read_text(&path).map_err(|e| {
        let names = SHIPPED.map(|(known, _)| known).join(", ");
        Refusal::new(&path, "sweep", e, format!("a TOML file, or one of {names}"))
    })?;
    Ok((path, source))
}
