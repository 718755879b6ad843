//! The means to run cells: the program, the data, the folders and the limits.

use std::path::{Path, PathBuf};

use crate::report::{Cell, Sweep};
use serde_json::Value;

use crate::process::{self, StageError};

/// The folder of a data set.
pub(crate) struct DataFolder {
    pub(crate) photographs: PathBuf,
    /// The file of the true surface, if it is known.
    pub(crate) truth: Option<PathBuf>,
}

/// Runs the cells of a sweep.
pub(crate) struct CellRunner<'a> {
    pub(crate) sweep: &'a Sweep,
    /// The program that fits.
    pub(crate) binary: &'a Path,
    /// The data sets, in the sweep's order.
    pub(crate) data: &'a [DataFolder],
    /// The folder of the cells' folders.
    pub(crate) cells: PathBuf,
    /// Threads of one cell.
    pub(crate) threads: usize,
}

impl CellRunner<'_> {
    /// The folder of a cell.
    pub(crate) fn folder(&self, cell: &Cell) -> PathBuf {
        self.cells.join(&cell.name)
    }

    /// The option of the cell's threads.
    pub(crate) fn threads(&self) -> String {
        format!("--threads={}", self.threads)
    }

    /// Runs a command with the sweep's limits; its standard error goes to `NAME.log`.
    pub(crate) fn command(
        &self,
        folder: &Path,
        name: &str,
        arguments: &[String],
    ) -> Result<Value, StageError> {
        let log = folder.join(format!("{name}.log"));
        process::run(self.binary, arguments, &self.sweep.limits, &log, &|| {})
    }
}

/// A path as an argument of the command line.
pub(crate) fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}
