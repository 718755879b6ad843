//! A sweep's output folder: its lock, its data, its cells, its report.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::report::files::{read_if_present, read_text, write_whole};
use crate::report::results::{CellResult, finished};
use crate::report::schema::DataSet;
use crate::report::{Cell, Sweep, write_report};
use files::InputError;

use crate::console::print;
use crate::inputs;
use crate::process::{self, StageError};
use crate::program_check::of_message;
use crate::runner::DataFolder;

/// A sweep with its folders.
pub(crate) struct SweepFolder {
    pub(crate) sweep: Sweep,
    /// The folder of the sweep file, where its paths start.
    pub(crate) base: PathBuf,
    /// The output folder.
    pub(crate) output: PathBuf,
}

/// The files of a finished cell that a merge copies; `result.json`, which marks it as finished, is
/// the last.
const MERGED: [&str; 2] = ["picture.png", "result.json"];

impl SweepFolder {
    /// The folder of the cells' folders.
    pub(crate) fn cells(&self) -> PathBuf {
        self.output.join("cells")
    }

    /// The folder of a cell.
    pub(crate) fn cell(&self, cell: &Cell) -> PathBuf {
        self.cells().join(&cell.name)
    }

    /// Locks the output folder for this process and keeps the sweep in it as `sweep.toml`. The lock
    /// ends with the returned file.
    ///
    /// # Errors
    /// An [`InputError`] if another process holds the lock, or if the folder is of another sweep.
    pub(crate) fn lock(&self) -> Result<std::fs::File, Error> {
        let path = self.output.join("lock");
        // Another program's file of this name keeps its content.
        let lock = std::fs::File::options().write(true).create(true).truncate(false).open(&path);
        let lock =
            lock.map_err(|e| InputError::new(&path, "lock", e, "a folder that can be written"))?;
        if lock.try_lock().is_err() {
            let (found, expected) = ("another sweep is writing here", "another folder");
            return Err(InputError::new(&self.output, "lock", found, expected).into());
        }
        let (path, text) =
            (self.output.join("sweep.toml"), toml::to_string(&self.sweep).map_err(Error::content)?);
        if let Some(known) = read_if_present(&path)? {
            self.check_same_cells(&path, &known)?;
        }
        write_whole(&path, text)?;
        Ok(lock)
    }

    /// Refuses a sweep file whose cells differ from those of this sweep.
    fn check_same_cells(&self, path: &Path, text: &str) -> Result<(), Error> {
        let expected = "the same sweep, or another folder";
        let own = toml::to_string(&self.sweep.identity()).map_err(Error::content)?;
        let other = toml::from_str::<Sweep>(text).map(|sweep| toml::to_string(&sweep.identity()));
        let Ok(Ok(other)) = other else {
            return Err(InputError::new(path, "sweep", "no sweep", expected).into());
        };
        if own != other {
            let found = inputs::first_difference(&other, &own);
            return Err(InputError::new(path, "sweep", found, expected).into());
        }
        Ok(())
    }

    /// The folders of the data sets. Views of a scene are rendered if their folder is missing.
    pub(crate) fn data_folders(&self, binary: &Path) -> Result<Vec<DataFolder>, Error> {
        self.sweep.data.iter().map(|data| self.data_folder(data, binary)).collect()
    }

    fn data_folder(&self, data: &DataSet, binary: &Path) -> Result<DataFolder, Error> {
        let mesh = data.mesh.as_deref().map(|mesh| self.base.join(mesh));
        if let Some(dataset) = &data.dataset {
            let photographs = std::path::absolute(self.base.join(dataset))?;
            return Ok(DataFolder { photographs, truth: mesh });
        }
        let photographs = self.output.join("data").join(&data.name);
        if !photographs.exists() {
            self.render_views(data, &photographs, binary)?;
        }
        let truth = Some(mesh.unwrap_or_else(|| photographs.join("truth.ply")));
        Ok(DataFolder { photographs, truth })
    }

    /// Renders the views of a scene into `folder`, which appears whole or not at all.
    fn render_views(&self, data: &DataSet, folder: &Path, binary: &Path) -> Result<(), Error> {
        let scene = self.base.join(data.scene.as_deref().unwrap_or_default());
        let (part, log) = (folder.with_extension("part"), folder.with_extension("log"));
        let _ = std::fs::remove_dir_all(&part);
        std::fs::create_dir_all(part.parent().ok_or_else(Error::lacks("a folder"))?)?;
        let (views, size) = (data.views.to_string(), format!("{0}x{0}", data.size));
        let (scene_name, out) = (scene.to_string_lossy(), part.to_string_lossy());
        let arguments = ["synth", &scene_name, "-o", &out, "--views", &views, "--size", &size];
        let arguments = arguments.map(str::to_owned);
        process::run(binary, &arguments, &self.sweep.limits, &log, &|| {}).map_err(|error| {
            match error {
                StageError::Cell(failure) => {
                    let expected = "a scene to take pictures of";
                    of_message(&scene, "data", &failure.reason, expected).into()
                }
                StageError::Sweep(error) => error,
            }
        })?;
        Ok(std::fs::rename(&part, folder)?)
    }

    /// Copies finished cells from other folders of the same sweep, with the origin of their data.
    ///
    /// # Errors
    /// An [`InputError`] if a folder is of another sweep or of other data.
    pub(crate) fn merge(&self, folders: &[PathBuf]) -> Result<(), Error> {
        for folder in folders {
            let path = folder.join("sweep.toml");
            let text = read_text(&path)
                .map_err(|e| InputError::new(&path, "sweep", e, "a shard of this sweep"))?;
            self.check_same_cells(&path, &text)?;
        }
        inputs::merge(folders, &self.output)?;
        for cell in self.sweep.cells() {
            self.merge_cell(&cell, folders)?;
        }
        Ok(())
    }

    /// Copies a cell from the first folder that has it finished, unless it is here.
    fn merge_cell(&self, cell: &Cell, folders: &[PathBuf]) -> Result<(), Error> {
        let to = self.cell(cell);
        if finished(&to).is_some() {
            return Ok(());
        }
        let candidates = folders.iter().map(|folder| folder.join("cells").join(&cell.name));
        let Some(from) = candidates.into_iter().find(|from| finished(from).is_some()) else {
            return Ok(());
        };
        std::fs::create_dir_all(&to)?;
        for name in MERGED {
            if let Ok(bytes) = std::fs::read(from.join(name)) {
                write_whole(&to.join(name), bytes)?;
            }
        }
        Ok(())
    }

    /// Writes results and report of the finished cells, in the sweep's order, and prints the path
    /// of the report.
    pub(crate) fn write_report(&self) -> Result<(), Error> {
        let mut pictures = HashMap::new();
        let mut results = Vec::new();
        for cell in self.sweep.cells() {
            if let Some(mut result) = finished(&self.cell(&cell)) {
                // The sweep's criterion may have changed since the cell was run.
                let has_truth = self.sweep.data[cell.data].has_truth();
                result.converged = result.meets(&self.sweep.converged, has_truth);
                pictures.insert(result.key(), self.cell(&cell).join("picture.png"));
                results.push(result);
            }
        }
        let picture =
            |result: &CellResult| pictures.get(&result.key()).cloned().unwrap_or_default();
        let machines = inputs::machines(&self.output)?;
        write_report(&self.sweep, &results, &machines, &self.output, &picture)?;
        print(&format!("{}\n", self.output.join("report.md").display()));
        Ok(())
    }
}
