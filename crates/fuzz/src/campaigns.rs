//! Campaigns of all readers: `fuzz campaigns`, which `cargo xtask fuzz` runs.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::bail;

use fuzz::READERS;
use fuzz::campaign::{Campaign, Cases, Limits, Tally};

/// The options of a run.
pub(crate) struct Options {
    /// Time for each reader.
    pub(crate) time: Duration,
    /// The seed of the cases.
    pub(crate) seed: u64,
    /// The folder for the files of the findings.
    pub(crate) output: PathBuf,
    /// The folder of the kept cases, with a folder for each reader.
    pub(crate) corpus: PathBuf,
    /// The only reader; all of them if it is empty.
    pub(crate) reader: String,
}

/// Runs the kept cases and then new ones, prints a table, and keeps the files of each finding.
///
/// # Errors
/// If there is no such reader, a process cannot be started, or there is a finding.
pub(crate) fn run(options: &Options) -> anyhow::Result<()> {
    let mut names: Vec<&str> = READERS.iter().map(|reader| reader.name).collect();
    if !options.reader.is_empty() {
        names.retain(|name| *name == options.reader);
        if names.is_empty() {
            bail!("no reader {}", options.reader);
        }
    }
    let program = std::env::current_exe()?;
    println!("| reader | executions | accepted | refused | findings | seconds |");
    println!("|---|---|---|---|---|---|");
    let mut findings = 0;
    for name in names {
        findings += run_reader(&program, name, options)?;
    }
    if findings > 0 {
        bail!("{findings} findings, with their files in {}", options.output.display());
    }
    Ok(())
}

/// Runs one reader, prints its row, and returns the number of its findings.
fn run_reader(program: &Path, reader: &str, options: &Options) -> anyhow::Result<usize> {
    let campaign =
        Campaign { program, reader, limits: Limits::default(), keep: Some(&options.output) };
    let start = Instant::now();
    let kept = campaign.run(Cases::Kept(&options.corpus.join(reader)))?;
    let new = campaign.run(Cases::Time(options.seed, options.time))?;
    let sum = |value: fn(&Tally) -> u64| value(&kept) + value(&new);
    let findings = kept.findings.len() + new.findings.len();
    println!(
        "| {reader} | {} | {} | {} | {findings} | {:.0} |",
        sum(Tally::executions),
        sum(|tally| tally.accepted),
        sum(|tally| tally.refused),
        start.elapsed().as_secs_f64()
    );
    eprint!("{}{}", kept.describe(), new.describe());
    Ok(findings)
}
