//! Development commands of dsdf: `cargo xtask ci`.

use std::process::Command;

use anyhow::{Context, bail};
use clap::{Parser, Subcommand};

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
}

fn main() -> anyhow::Result<()> {
    match Cli::parse().command {
        Task::Ci => ci(),
    }
}

/// Runs every check and stops at the first that fails.
fn ci() -> anyhow::Result<()> {
    cargo(&["fmt", "--all", "--check"], &[])?;
    cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"], &[])?;
    cargo(&["doc", "--workspace", "--no-deps"], &[("RUSTDOCFLAGS", "-D warnings")])?;
    cargo(&["test", "--workspace"], &[])
}

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
