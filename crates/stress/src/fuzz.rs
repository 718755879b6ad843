//! Campaigns of all readers, for `cargo xtask fuzz`.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use measure::dsdf::{build_package, root};

use crate::WrongArgument;
use crate::campaign::{Campaign, Cases, Limits, Tally};

/// The options of a run.
#[derive(Clone, Debug)]
pub struct Options {
    /// Time for each reader.
    pub time: Duration,
    /// The only reader; all of them without it.
    pub reader: Option<String>,
    /// The seed of the cases.
    pub seed: u64,
    /// The folder for the files of the findings.
    pub output: PathBuf,
}

/// Runs the kept cases and then new ones, prints a table, and keeps the files of each finding.
///
/// # Errors
/// A [`WrongArgument`] if there is no such reader. Other errors if there is a finding, or the
/// program cannot be built.
pub fn run(options: &Options) -> anyhow::Result<()> {
    // The profile of the tests: overflows and failed debug assertions are findings.
    let program = build_package("fuzz", "dev")?;
    let mut names = readers(&program)?;
    if let Some(only) = &options.reader {
        if !names.contains(only) {
            let message = format!("--reader: found {only}, expected one of {}", names.join(", "));
            return Err(WrongArgument(message).into());
        }
        names.retain(|name| name == only);
    }
    println!("| reader | executions | accepted | refused | findings | seconds |");
    println!("|---|---|---|---|---|---|");
    let mut findings = 0;
    for name in &names {
        findings += run_reader(&program, name, options)?;
    }
    if findings > 0 {
        bail!("{findings} findings, with their files in {}", options.output.display());
    }
    Ok(())
}

/// The names of all readers.
fn readers(program: &Path) -> anyhow::Result<Vec<String>> {
    let output = Command::new(program).arg("readers").output().context("the list of readers")?;
    Ok(String::from_utf8(output.stdout)?.lines().map(str::to_owned).collect())
}

/// Runs one reader, prints its row, and returns the number of its findings.
fn run_reader(program: &Path, reader: &str, options: &Options) -> anyhow::Result<usize> {
    let campaign =
        Campaign { program, reader, limits: Limits::default(), keep: Some(&options.output) };
    let start = Instant::now();
    let kept = campaign.run(Cases::Kept(&root().join("crates/fuzz/corpus").join(reader)))?;
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
