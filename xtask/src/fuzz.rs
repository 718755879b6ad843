//! `cargo xtask fuzz`: campaigns of hostile files for all readers.
//!
//! The program `fuzz` generates the files, reads them in processes of its own, and prints the
//! table. xtask only builds and starts it: so xtask links no crate of the renderer.

use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use anyhow::{Context, ensure};
use clap::Args;
use sweep::measure::dsdf::build_package;
use sweep::measure::workspace_root;

use crate::arguments::{WrongArgument, minutes};

/// Arguments of `cargo xtask fuzz`.
#[derive(Args)]
pub(crate) struct Fuzz {
    /// Minutes for each reader
    #[arg(long, default_value = "1", value_parser = minutes)]
    minutes: Duration,
    /// The only reader to run [default: all]
    #[arg(long)]
    reader: Option<String>,
    /// Seed of the files
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for the files of the findings
    #[arg(short, long, default_value = "target/fuzz")]
    output: PathBuf,
}

impl Fuzz {
    /// Builds the program, checks the name of the reader, and runs the campaigns.
    pub(crate) fn run(self) -> anyhow::Result<()> {
        // The profile of the tests: overflows and failed debug assertions are findings.
        let program = build_package("dsdf-fuzz", "ci")?;
        let output = Command::new(&program).arg("readers").output();
        let names = String::from_utf8(output.context("the list of readers")?.stdout)?;
        if let Some(only) = &self.reader
            && !names.lines().any(|name| name == only)
        {
            let expected: Vec<&str> = names.lines().collect();
            let message =
                format!("--reader: found {only}, expected one of {}", expected.join(", "));
            return Err(WrongArgument(message).into());
        }
        let status = Command::new(&program)
            .arg("campaigns")
            .arg(self.minutes.as_secs_f64().to_string())
            .arg(self.seed.to_string())
            .arg(&self.output)
            .arg(workspace_root().join("crates/fuzz/corpus"))
            .arg(self.reader.unwrap_or_default())
            .status()?;
        ensure!(status.success(), "the campaigns: {status}");
        Ok(())
    }
}
