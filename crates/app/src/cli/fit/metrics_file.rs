//! `metrics.jsonl` of a run folder.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::Path;

use fit::Metrics;

/// `metrics.jsonl`: one line of JSON per iteration.
pub(super) struct MetricsFile {
    writer: BufWriter<File>,
}

impl MetricsFile {
    /// Opens the file for appending. Lines after `iteration` are removed: a killed run leaves lines
    /// that are newer than its checkpoint.
    pub(super) fn open(path: &Path, iteration: u64) -> anyhow::Result<Self> {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        let kept: String = text
            .lines()
            .filter(|line| iteration_of(line).is_some_and(|i| i <= iteration))
            .flat_map(|line| [line, "\n"])
            .collect();
        io::atomic_write(path, |out| Ok(out.write_all(kept.as_bytes())?))?;
        let file = OpenOptions::new().append(true).open(path)?;
        Ok(MetricsFile { writer: BufWriter::new(file) })
    }

    /// Appends one line.
    pub(super) fn write(&mut self, metrics: &Metrics) -> anyhow::Result<()> {
        serde_json::to_writer(&mut self.writer, metrics)?;
        self.writer.write_all(b"\n")?;
        Ok(self.writer.flush()?)
    }
}

/// The iteration of a line; `None` if the line is incomplete.
fn iteration_of(line: &str) -> Option<u64> {
    let value: Option<serde_json::Value> = serde_json::from_str(line).ok();
    value.and_then(|v| v["iteration"].as_u64())
}
