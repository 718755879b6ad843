//! Prepares a run folder before the first iteration: checks, lock, subfolders and `fit.toml`.

use std::fs::{File, create_dir_all};
use std::path::{Path, PathBuf};

use files::InputError;
use fit::{RunFile, RunFolder};

use crate::cli::common::Global;

/// Checks that a fit can write its files in the folder.
pub(super) fn check_output(run: &Path, global: &Global) -> anyhow::Result<()> {
    global.will_write_in(run, &RunFolder::SUBFOLDERS)
}

/// Refuses to resume a run that ended before its first checkpoint.
pub(super) fn refuse_without_checkpoint(run: &Path) -> Result<(), InputError> {
    if exists(&RunFolder::new(run).checkpoint()) {
        return Ok(());
    }
    let expected = "one to continue from: without --resume, the fit starts again";
    Err(InputError::new(run, "checkpoint", "none", expected))
}

/// Refuses to start a new run in a folder with the results of another, or with files of no run that
/// it would replace.
///
/// A folder of a run that ended before its first checkpoint is accepted, and so are files with
/// other names than those of a run.
pub(in crate::cli) fn refuse_occupied(run: &Path) -> Result<(), InputError> {
    if exists(&RunFolder::new(run).checkpoint()) {
        let expected = "a new folder, or --resume to continue this run";
        return Err(InputError::new(run, "run", "a run with a checkpoint", expected));
    }
    let is_run = RunFile::load(run).is_ok();
    let folder = RunFolder::new(run);
    let [checkpoints, previews] = folder.subfolders();
    let of_start = [folder.fit_toml(), folder.metrics(), checkpoints, previews];
    let replaced = folder.results().into_iter().chain(of_start.into_iter().filter(|_| !is_run));
    for path in replaced {
        if exists(&path) && !is_empty_folder(&path) {
            let (found, expected) = ("a file that a new run would replace", "a new folder");
            return Err(InputError::new(path, "run", found, expected));
        }
    }
    Ok(())
}

/// Whether the path names anything, if only a link to nothing.
fn exists(path: &Path) -> bool {
    path.symlink_metadata().is_ok()
}

fn is_empty_folder(path: &Path) -> bool {
    path.read_dir().is_ok_and(|mut entries| entries.next().is_none())
}

/// Creates the folder of a run.
pub(super) fn create(folder: &Path) -> Result<(), InputError> {
    create_dir_all(folder)
        .map_err(|e| InputError::new(folder, "run", e, "a folder that can be written"))
}

/// Creates the subfolders of a run and writes its `fit.toml`.
pub(super) fn write_run_file(run: &Path, file: &RunFile) -> anyhow::Result<()> {
    create(run)?;
    RunFolder::new(run).subfolders().iter().try_for_each(|path| create(path))?;
    Ok(file.save(run)?)
}

/// Refuses a subfolder that is a link: a fit would write into another place.
fn refuse_links(run: &Path) -> Result<(), InputError> {
    for path in RunFolder::new(run).subfolders() {
        if path.is_symlink() {
            return Err(InputError::new(path, "run", "a link", "a folder of the run itself"));
        }
    }
    Ok(())
}

/// Locks a run folder for this process, until the returned file is dropped: two fits in one folder
/// would replace each other's files. Also removes the temporary files of killed fits there.
pub(in crate::cli) fn lock(run: &Path) -> Result<File, InputError> {
    refuse_links(run)?;
    let Some(lock) = files::lock(&RunFolder::new(run).lock())? else {
        let found = "another fit that is writing this folder";
        let expected = "a folder without a running fit: wait for it, or choose another";
        return Err(InputError::new(run, "run", found, expected));
    };
    files::remove_abandoned_temporary_files(run);
    let subfolders = RunFolder::new(run).subfolders();
    subfolders.iter().for_each(|path| files::remove_abandoned_temporary_files(path));
    Ok(lock)
}

/// `path` from the root: a run can be resumed from any working directory.
pub(super) fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}
