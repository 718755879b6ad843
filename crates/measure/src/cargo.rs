//! Running cargo.

use std::process::Command;

use anyhow::{Context, bail};

use crate::dsdf;

/// Cargo in the workspace's root.
pub fn cargo_command(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned()));
    command.args(arguments).current_dir(dsdf::root());
    command
}

/// Runs cargo and fails if it does.
pub fn cargo(arguments: &[&str], environment: &[(&str, &str)]) -> anyhow::Result<()> {
    let line = format!("cargo {}", arguments.join(" "));
    eprintln!("$ {line}");
    let status = cargo_command(arguments).envs(environment.iter().copied()).status();
    let status = status.with_context(|| format!("cannot start {line}"))?;
    if !status.success() {
        bail!("{line} failed");
    }
    Ok(())
}
