//! `metrics.jsonl` of a run folder.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use files::WriteError;

use crate::metrics::Metrics;

/// `metrics.jsonl`: one line of JSON per iteration.
pub(crate) struct MetricsFile {
    path: PathBuf,
    writer: BufWriter<File>,
}

impl MetricsFile {
    /// Opens the file for appending. Lines after `iteration` are removed: a killed run leaves lines
    /// that are newer than its checkpoint.
    ///
    /// # Errors
    /// If the file cannot be read or written.
    pub(crate) fn open(path: &Path, iteration: u64) -> Result<Self, WriteError> {
        let known = match path.symlink_metadata() {
            Ok(_) => files::read(path, "metrics", "the metrics of a run")?,
            Err(_) => Vec::new(),
        };
        let mut kept = Vec::new();
        for line in known.split(|byte| *byte == b'\n') {
            if iteration_of(line).is_some_and(|i| i <= iteration) {
                kept.extend_from_slice(line);
                kept.push(b'\n');
            }
        }
        files::atomic_write(path, |out| out.write_all(&kept))?;
        let file = OpenOptions::new().append(true).open(path);
        let file = file.map_err(|e| WriteError::of_file(path, e))?;
        Ok(MetricsFile { path: path.to_owned(), writer: BufWriter::new(file) })
    }

    /// Appends one line.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn write(&mut self, metrics: &Metrics) -> Result<(), WriteError> {
        self.append(metrics).map_err(|e| WriteError::of_file(&self.path, e))
    }

    fn append(&mut self, metrics: &Metrics) -> std::io::Result<()> {
        serde_json::to_writer(&mut self.writer, metrics)?;
        self.writer.write_all(b"\n")?;
        self.writer.flush()
    }
}

/// The iteration of a line; `None` if the line is incomplete or damaged.
fn iteration_of(line: &[u8]) -> Option<u64> {
    let value: Option<serde_json::Value> = serde_json::from_slice(line).ok();
    value.and_then(|v| v["iteration"].as_u64())
}
