//! `cargo xtask bench`: what this machine can do, and what of it every pass of the network uses.

mod programs;

use std::path::{Path, PathBuf};
use std::process::Stdio;

use anyhow::{Context, ensure};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use measure::host::{processor, revision};
use measure::{cargo_command, dsdf};
use programs::{Accuracy, Growth, Program};

/// All that a run measures.
#[derive(Serialize)]
struct Report {
    host: String,
    revision: String,
    threads: usize,
    #[serde(flatten)]
    machine: Machine,
    programs: Vec<Program>,
    accuracy: Accuracy,
    growth: Vec<Growth>,
}

/// What the bench `machine` of `sdf-nn` says.
#[derive(Deserialize, Serialize)]
struct Machine {
    peak: Value,
    passes: Value,
}

impl Machine {
    /// Runs it, built for release; its table goes to standard error.
    fn measure() -> anyhow::Result<Self> {
        let output = cargo_command(&["bench", "--package", "sdf-nn", "--bench", "machine"])
            .stderr(Stdio::inherit())
            .output()?;
        ensure!(output.status.success(), "cargo bench --package sdf-nn --bench machine failed");
        Ok(serde_json::from_slice(&output.stdout)?)
    }
}

/// Measures, prints a table, and writes the JSON.
pub(crate) fn run(output: Option<PathBuf>) -> anyhow::Result<()> {
    let path = output.unwrap_or_else(|| dsdf::root().join("target/bench.json"));
    let binary = dsdf::build()?;
    eprintln!("{}", processor());
    let machine = Machine::measure()?;
    println!("\n| program | seconds | peak memory, MiB |\n|---|---|---|");
    let programs = programs::measure(&binary)?;
    let accuracy = programs::accuracy(&binary)?;
    println!(
        "\nThe derivative at 4 samples: bias {:.2} % (the mean of 64 seeds has {:.2} % of noise), RMSE {:.1} %",
        100.0 * accuracy.bias,
        100.0 * accuracy.noise,
        100.0 * accuracy.rmse
    );
    println!("\n| seconds of a gradient grow with | as its power |\n|---|---|");
    let growth = programs::growth(&binary)?;
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let report = Report {
        host: processor(),
        revision: revision(),
        threads,
        machine,
        programs,
        accuracy,
        growth,
    };
    write(&path, &report)?;
    eprintln!("{}", path.display());
    Ok(())
}

fn write(path: &Path, report: &Report) -> anyhow::Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    serde_json::to_writer_pretty(&mut file, report)?;
    file.persist(path).with_context(|| path.display().to_string())?;
    Ok(())
}
