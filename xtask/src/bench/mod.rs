//! `cargo xtask bench`: the machine's peak, the throughput of every network pass, and the time and
//! memory of whole commands.

pub(crate) mod accuracy;
pub(crate) mod growth;
pub(crate) mod programs;
mod scenes;
pub(crate) mod workers;

use std::path::{Path, PathBuf};
use std::process::Stdio;

use anyhow::{Context, ensure};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use accuracy::Accuracy;
use growth::Growth;
use programs::CommandCost;
use sweep::measure::host::{processor, revision};
use sweep::measure::{cargo_command, dsdf, workspace_root};

/// All measurements, as the JSON file has them.
#[derive(Serialize)]
struct BenchResults {
    /// The processor.
    host: String,
    /// Of the source.
    revision: String,
    /// Threads that the system offers.
    threads: usize,
    #[serde(flatten)]
    machine: Machine,
    programs: Vec<CommandCost>,
    accuracy: Accuracy,
    growth: Vec<Growth>,
}

/// The results of the bench `machine` of `sdf-nn`, unchanged.
#[derive(Deserialize, Serialize)]
pub(crate) struct Machine {
    /// The peak of the processor.
    peak: Value,
    /// The throughput of every pass.
    passes: Value,
}

impl Machine {
    /// Runs the bench in the profile for benches; its table goes to standard error.
    pub(crate) fn measure() -> anyhow::Result<Self> {
        let output = cargo_command(&["bench", "--package", "dsdf-sdf-nn", "--bench", "machine"])
            .stderr(Stdio::inherit())
            .output()?;
        ensure!(
            output.status.success(),
            "cargo bench --package dsdf-sdf-nn --bench machine failed"
        );
        Ok(serde_json::from_slice(&output.stdout)?)
    }
}

/// Measures, prints tables, and writes the JSON file `output`.
pub(crate) fn run(output: Option<PathBuf>) -> anyhow::Result<()> {
    let path = output.unwrap_or_else(|| workspace_root().join("target/bench.json"));
    let binary = dsdf::build()?;
    eprintln!("{}", processor());
    let results = BenchResults {
        host: processor(),
        machine: Machine::measure()?,
        programs: programs::measure(&binary)?,
        accuracy: accuracy::measure(&binary)?,
        growth: growth::measure(&binary)?,
        threads: std::thread::available_parallelism().map_or(1, usize::from),
        revision: revision(),
    };
    write(&path, &results)?;
    eprintln!("{}", path.display());
    Ok(())
}

/// Replaces the JSON file whole.
fn write(path: &Path, results: &impl Serialize) -> anyhow::Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    serde_json::to_writer_pretty(&mut file, results)?;
    file.persist(path).with_context(|| path.display().to_string())?;
    Ok(())
}
