//! The output of COLMAP: its log, and the line of an error.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use files::WriteError;

/// The name of the log in the folder of a data set.
pub(crate) const LOG: &str = "colmap.log";

/// Words of lines that tell an error.
const SIGNS: [&str; 6] =
    ["ERROR", "Error:", "Check failed", "Could not", "terminate called", "unrecognised option"];

/// The log of all commands.
pub(crate) struct Log {
    path: PathBuf,
    file: File,
    /// The last line of the command that is not empty.
    last: String,
    /// The last line of the command that tells an error.
    error: Option<String>,
}

impl Log {
    /// Opens the log in a folder. An old one is kept if `keeps`.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn open(folder: &Path, keeps: bool) -> Result<Self, WriteError> {
        let path = folder.join(LOG);
        let mut options = File::options();
        options.create(true);
        if keeps {
            options.append(true)
        } else {
            options.write(true).truncate(true)
        };
        let file = options.open(&path).map_err(|e| WriteError::of_file(&path, e))?;
        Ok(Log { path, file, last: String::new(), error: None })
    }

    /// Begins the output of a command.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn begin(&mut self, arguments: &[String]) -> Result<(), WriteError> {
        (self.last, self.error) = (String::new(), None);
        self.write(&format!("$ colmap {}", arguments.join(" ")))
    }

    /// Adds a line.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn add(&mut self, line: &str) -> Result<(), WriteError> {
        if !line.trim().is_empty() {
            line.trim().clone_into(&mut self.last);
        }
        if SIGNS.iter().any(|sign| line.contains(sign)) {
            self.error = Some(line.trim().to_owned());
        }
        self.write(line)
    }

    fn write(&mut self, line: &str) -> Result<(), WriteError> {
        writeln!(self.file, "{line}").map_err(|e| WriteError::of_file(&self.path, e))
    }

    /// The line of the command that tells its error best.
    pub(crate) fn error(&self) -> &str {
        self.error.as_deref().unwrap_or(&self.last)
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_is_the_last_line_that_tells_one_or_the_last_line() {
        let folder = tempfile::tempdir().unwrap();
        let mut log = Log::open(folder.path(), false).unwrap();
        log.begin(&["mapper".to_owned()]).unwrap();
        for line in ["a", "  ERROR: no b", "", "c", ""] {
            log.add(line).unwrap();
        }
        assert_eq!(log.error(), "ERROR: no b");
        log.begin(&["mapper".to_owned()]).unwrap();
        log.add(" d ").unwrap();
        assert_eq!(log.error(), "d");
        drop(log);
        Log::open(folder.path(), true).unwrap().add("e").unwrap();
        let text = std::fs::read_to_string(folder.path().join(LOG)).unwrap();
        let expected = "$ colmap mapper\na\n  ERROR: no b\n\nc\n\n$ colmap mapper\n d \ne\n";
        assert_eq!(text, expected);
    }
}
