//! What a measurement of the record is: rows that are measured one by one, and files made of them.

use std::fs::File;
use std::path::{Path, PathBuf};

use serde_json::Value;
use sweep::measure::workspace_root;

use super::rows::{Planned, Rows};

/// A measurement: a folder of `docs/results`, with rows that are measured one by one.
pub(crate) trait Measurement: Sync {
    /// Its name: the folder.
    fn name(&self) -> &'static str;

    /// What its numbers depend on: crates with all that these depend on, and single files.
    fn measured(&self) -> &'static [&'static str];

    /// The rows, in the order of the tables.
    ///
    /// # Errors
    /// If they cannot be listed.
    fn plan(&self) -> anyhow::Result<Vec<Planned>>;

    /// Measures a row.
    ///
    /// # Errors
    /// If the measurement fails; [`Skipped`] if it cannot run here.
    fn measure(&self, row: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value>;

    /// Writes tables and plots of the rows into the folder of the measurement. Rows that were never
    /// measured are missing.
    ///
    /// # Errors
    /// If a file cannot be written, or a row lacks a value.
    fn write(&self, rows: &Rows, folder: &Path) -> anyhow::Result<()>;
}

/// The error of a row that cannot be measured on this machine: a program is missing.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct Skipped(pub(crate) String);

/// What a row is measured with.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bench<'a> {
    /// The program `dsdf`.
    pub(crate) program: &'a Path,
    /// A folder of the row's own: a measurement that was killed left it as it was.
    pub(crate) scratch: &'a Path,
    /// The folder of the measurement, for pictures of the row.
    pub(crate) folder: &'a Path,
}

/// The folder of data sets and references that are not in the repository.
pub(crate) fn shared() -> PathBuf {
    workspace_root().join("../shared")
}

/// The Python of an environment of this name, which `install` makes in a folder if it was never made to
/// its end, or with other `packages`.
///
/// # Errors
/// If it cannot be made.
pub(crate) fn environment(
    name: &str,
    packages: &str,
    install: impl FnOnce(&Path) -> anyhow::Result<()>,
) -> anyhow::Result<PathBuf> {
    let folder = workspace_root().join("target/record/environments").join(name);
    let done = folder.join("installed");
    if std::fs::read_to_string(&done).ok().as_deref() != Some(packages) {
        install(&folder)?;
        std::fs::write(&done, packages)?;
    }
    Ok(python_of(&folder))
}

/// Waits until no process writes a folder of a fit or a sweep: the child of a `record` that was killed
/// may still do so.
///
/// # Errors
/// If the lock of the folder cannot be taken.
pub(crate) fn wait_for_orphan(folder: &Path) -> anyhow::Result<()> {
    let Ok(lock) = File::open(folder.join("lock")) else { return Ok(()) };
    if lock.try_lock().is_err() {
        eprintln!("{}: waiting for what a killed record began", folder.display());
        lock.lock()?;
    }
    Ok(())
}

/// The Python of the environment in a folder.
pub(crate) fn python_of(folder: &Path) -> PathBuf {
    folder.join("bin/python")
}
