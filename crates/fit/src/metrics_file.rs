//! `metrics.jsonl` of a run folder.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::iteration::Metrics;

/// `metrics.jsonl`: one line of JSON per iteration.
pub struct MetricsFile {
    path: PathBuf,
    writer: BufWriter<File>,
}

impl MetricsFile {
    /// Opens the file for appending. Lines after `iteration` are removed: a killed run leaves lines
    /// that are newer than its checkpoint.
    ///
    /// # Errors
    /// If the file cannot be read or written.
    pub fn open(path: &Path, iteration: u64) -> anyhow::Result<Self> {
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
        let file = file.with_context(|| format!("cannot write {}", path.display()))?;
        Ok(MetricsFile { path: path.to_owned(), writer: BufWriter::new(file) })
    }

    /// Appends one line.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&mut self, metrics: &Metrics) -> anyhow::Result<()> {
        self.append(metrics).with_context(|| format!("cannot write {}", self.path.display()))
    }

    fn append(&mut self, metrics: &Metrics) -> anyhow::Result<()> {
        serde_json::to_writer(&mut self.writer, metrics)?;
        self.writer.write_all(b"\n")?;
        Ok(self.writer.flush()?)
    }
}

/// The iteration of a line; `None` if the line is incomplete or damaged.
fn iteration_of(line: &[u8]) -> Option<u64> {
    let value: Option<serde_json::Value> = serde_json::from_slice(line).ok();
    value.and_then(|v| v["iteration"].as_u64())
}
