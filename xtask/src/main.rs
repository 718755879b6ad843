//! Development commands of dsdf: `cargo xtask ci` and `cargo xtask figures`.

mod dsdf;
mod figures;
mod plot;

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, bail};
use clap::{Parser, Subcommand};

use figures::Figure;

/// Development commands of dsdf.
#[derive(Parser)]
struct Cli {
    #[command(subcommand)]
    command: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Format, lints, documentation and tests, as the continuous integration runs them
    Ci,
    /// Measure what the documentation shows, and write its tables and plots
    Figures {
        /// What to measure
        figure: Figure,
        /// Where to write [default: docs/results/FIGURE]
        #[arg(short, long)]
        output: Option<PathBuf>,
    },
}

fn main() -> anyhow::Result<()> {
    match Cli::parse().command {
        Task::Ci => ci(),
        Task::Figures { figure, output } => figures::run(figure, output),
    }
}

/// Runs every check and stops at the first that fails.
fn ci() -> anyhow::Result<()> {
    cargo(&["fmt", "--all", "--check"], &[])?;
    cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"], &[])?;
    cargo(&["doc", "--workspace", "--no-deps"], &[("RUSTDOCFLAGS", "-D warnings")])?;
    cargo(&["test", "--workspace"], &[])
}

/// Runs cargo and fails if it does.
fn cargo(arguments: &[&str], environment: &[(&str, &str)]) -> anyhow::Result<()> {
    let line = format!("cargo {}", arguments.join(" "));
    eprintln!("$ {line}");
    let program = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let status = Command::new(program).args(arguments).envs(environment.iter().copied()).status();
    let status = status.with_context(|| format!("cannot start {line}"))?;
    if !status.success() {
        bail!("{line} failed");
    }
    Ok(())
}
