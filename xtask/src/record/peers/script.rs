//! The scripts in `xtask/peers`, and the Python that runs them.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, bail};
use serde_json::Value;
use sweep::measure::workspace_root;

use super::super::measurement::{Skipped, environment};

/// The status of a script that cannot run here.
const CANNOT_RUN: i32 = 3;

/// The Python of the peers, in an environment of their own, made if it is not there.
pub(super) fn python() -> anyhow::Result<PathBuf> {
    let packages = std::fs::read_to_string(workspace_root().join("xtask/peers/peers.py"))?;
    environment("peers", &packages, |folder| {
        script(Path::new("python3"), "install.py", &[&folder.to_string_lossy()]).map(|_| ())
    })
}

/// Runs a script, whose progress goes to standard error, and returns its JSON.
pub(super) fn script(python: &Path, name: &str, arguments: &[&str]) -> anyhow::Result<Value> {
    let path = workspace_root().join("xtask/peers").join(name);
    let output = Command::new(python).arg(path).args(arguments).stderr(Stdio::inherit()).output();
    let output = output.with_context(|| python.display().to_string())?;
    if output.status.code() == Some(CANNOT_RUN) {
        let reason = String::from_utf8_lossy(&output.stdout);
        let reason = reason.trim().trim_start_matches("SKIPPED: ");
        return Err(Skipped(format!("{name}: {reason}")).into());
    }
    if !output.status.success() {
        bail!("{name} failed");
    }
    serde_json::from_slice(&output.stdout).with_context(|| name.to_owned())
}
