//! The files of a run folder that a fit writes before its first iteration.

use std::fs::{File, TryLockError, create_dir_all};
use std::path::{Path, PathBuf};

use fit::RunFile;
use io::InputError;

/// Refuses to start a new run in a folder that has a checkpoint.
pub(super) fn refuse_checkpoint(run: &Path) -> Result<(), InputError> {
    if run.join("checkpoint/state.safetensors").exists() {
        let expected = "a new folder, or --resume to continue this run";
        return Err(InputError::new(run, "run", "a run with a checkpoint", expected));
    }
    Ok(())
}

/// Creates the folder of a run.
pub(super) fn create(folder: &Path) -> Result<(), InputError> {
    create_dir_all(folder)
        .map_err(|e| InputError::new(folder, "run", e, "a folder that can be written"))
}

/// Creates the subfolders of a run and writes its `fit.toml`.
pub(super) fn write_run_file(run: &Path, file: &RunFile) -> anyhow::Result<()> {
    for folder in [run.to_owned(), run.join("checkpoint"), run.join("preview")] {
        create(&folder)?;
    }
    file.save(run)
}

/// Locks a run folder for this process, until the returned file is dropped: two fits in one folder
/// would replace each other's files.
///
/// On file systems without locks, the folder stays unlocked.
pub(super) fn lock(run: &Path) -> Result<File, InputError> {
    let path = run.join("lock");
    let file = File::create(&path)
        .map_err(|e| InputError::new(&path, "lock", e, "a file that can be written"))?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => {
            let found = "another fit that is writing this folder";
            let expected = "a folder without a running fit: wait for it, or choose another";
            Err(InputError::new(run, "run", found, expected))
        }
        _ => Ok(file),
    }
}

/// `path` from the root: a run can be resumed from any working directory.
pub(super) fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}
