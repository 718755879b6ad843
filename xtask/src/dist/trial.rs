//! What the archive and the wheel share: the trial, and the file's size and checksum.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};
use sweep::measure::workspace_root;

/// The embedded example as a trial: 8 images of 32 × 32 pixels, and a fit of two seconds.
pub(super) const TRIAL: [(&str, &str); 3] = [("views", "8"), ("size", "32"), ("time", "2s")];

/// The surface that the trial writes.
const TRIAL_RESULT: &str = "mesh.ply";

/// The folder of cargo's results.
pub(super) fn built() -> PathBuf {
    workspace_root().join(std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()))
}

/// Checks that the trial wrote its surface.
pub(super) fn check(output: &Path) -> anyhow::Result<()> {
    let mesh = output.join(TRIAL_RESULT);
    ensure!(mesh.is_file(), "the trial ended without {TRIAL_RESULT}");
    Ok(())
}

/// Prints a file with its size, and writes and prints its SHA-256.
pub(super) fn tell(file: &Path) -> anyhow::Result<()> {
    let (folder, name) =
        (file.parent().context("no folder")?, file.file_name().context("no name")?);
    let sum = text_of(Command::new("sha256sum").arg(name).current_dir(folder))?;
    let mut sum_name = name.to_owned();
    sum_name.push(".sha256");
    std::fs::write(folder.join(sum_name), &sum)?;
    println!("{}: {:.1} MB", file.display(), file.metadata()?.len() as f64 / 1e6);
    println!("SHA-256 {}", sum.trim());
    Ok(())
}

/// The standard output of a command.
pub(super) fn text_of(command: &mut Command) -> anyhow::Result<String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = command.output().with_context(|| format!("cannot start {name}"))?;
    if !output.status.success() {
        bail!("{name}: {}", String::from_utf8_lossy(&output.stderr).trim());
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}
