//! The state of a data set: its photographs, and the steps that are done.

use std::path::Path;

use files::{InputError, WriteError};
use serde::{Deserialize, Serialize};

use crate::photographs::{PhotoFile, Photographs};
use crate::result::Poses;
use crate::step::Entry;

/// The name of the file with the state.
pub(crate) const FILE: &str = "poses.json";

/// The content of `poses.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct State {
    /// The version of COLMAP that made the results.
    pub(crate) colmap: String,
    pub(crate) photographs: Vec<PhotoFile>,
    /// The step that was started last.
    pub(crate) started: Option<Entry>,
    /// The finished steps, in their order.
    pub(crate) done: Vec<Entry>,
    /// The result, once all steps are done.
    pub(crate) result: Option<Poses>,
}

impl State {
    /// The state of a folder before the first step, or the one that it has.
    ///
    /// # Errors
    /// If the folder has other files, or the poses of other photographs, or if its state cannot be
    /// read.
    pub(crate) fn of(folder: &Path, photographs: &Photographs) -> Result<Self, InputError> {
        let path = folder.join(FILE);
        if !path.is_file() {
            refuse_other_files(folder)?;
            let photographs = photographs.files.clone();
            let (colmap, done) = (String::new(), Vec::new());
            return Ok(State { colmap, photographs, started: None, done, result: None });
        }
        let text = files::read_text(&path, "file", "a state of `dsdf poses`")?;
        let state: State = serde_json::from_str(&text)
            .map_err(|e| InputError::new(&path, "state", e, "a state of `dsdf poses`"))?;
        state.refuse_others(&path, photographs)?;
        Ok(state)
    }

    /// Refuses photographs that are not those of this state.
    fn refuse_others(&self, path: &Path, photographs: &Photographs) -> Result<(), InputError> {
        if self.photographs == photographs.files {
            return Ok(());
        }
        let (old, new) = (&self.photographs, &photographs.files);
        let lacks = |files: &[PhotoFile], name: &str| files.iter().all(|file| file.name != name);
        let added = new.iter().find(|file| lacks(old, &file.name));
        let gone = old.iter().find(|file| lacks(new, &file.name));
        let changed = new.iter().find(|file| !old.contains(file));
        let difference = match (added, gone, changed) {
            (Some(file), ..) => format!("{} is new", file.name),
            (_, Some(file), _) => format!("{} is missing", file.name),
            (.., Some(file)) => format!("{} has another content", file.name),
            _ => "their order differs".to_owned(),
        };
        let found = format!(
            "{} photographs of {}: {difference}",
            photographs.count(),
            photographs.folder.display()
        );
        let expected = format!(
            "the {} photographs that this data set was started with, or a new folder",
            self.photographs.len()
        );
        Err(InputError::new(path, "photographs", found, expected))
    }

    /// Writes the state, whole.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn save(&self, folder: &Path) -> Result<(), WriteError> {
        files::atomic_write(&folder.join(FILE), |out| {
            writeln!(out, "{}", serde_json::to_string_pretty(self)?)
        })
    }

    /// The number of steps, from the first one on, that are done with these settings.
    pub(crate) fn done_with(&self, settings: &[Entry]) -> usize {
        self.done.iter().zip(settings).take_while(|(done, asked)| done == asked).count()
    }
}

/// Refuses a folder with files that are not those of `dsdf poses`.
fn refuse_other_files(folder: &Path) -> Result<(), InputError> {
    let expected = "a new folder, or one of `dsdf poses` with the same photographs";
    if folder.is_file() {
        return Err(InputError::new(folder, "output", "a file", expected));
    }
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> =
        entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    // A lock and a temporary file are left by a process that ended at its start.
    let is_other = |name: &&String| *name != "lock" && !name.starts_with(".dsdf-");
    match names.iter().find(is_other) {
        Some(name) => {
            let found = format!("a folder with other files ({name})");
            Err(InputError::new(folder, "output", found, expected))
        }
        None => Ok(()),
    }
}
