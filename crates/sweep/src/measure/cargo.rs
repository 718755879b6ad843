//! Running cargo in the workspace.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::{Error, ProcessFailure};

/// The workspace's root folder.
pub fn workspace_root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).map(Path::to_owned).unwrap_or_default()
}

/// The command `cargo` with these arguments, to be run in the workspace's root.
///
/// The environment variable `CARGO` names the program, which makes nested calls use the same one.
pub fn cargo_command(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned()));
    command.args(arguments).current_dir(workspace_root());
    command
}

/// Prints the command line to standard error and runs cargo.
///
/// `environment` holds variables and values that are added to those of this process.
///
/// # Errors
/// If cargo cannot be started, or ends with a status other than 0.
pub fn cargo(arguments: &[&str], environment: &[(&str, &str)]) -> Result<(), Error> {
    let line = format!("cargo {}", arguments.join(" "));
    eprintln!("$ {line}");
    let status = cargo_command(arguments).envs(environment.iter().copied()).status();
    let status = status.map_err(Error::action(format!("cannot start {line}")))?;
    if !status.success() {
        return Err(ProcessFailure::failed(format!("{line} failed")).into());
    }
    Ok(())
}
