//! Commands of `dsdf` as readers, in processes of their own: their messages reach a terminal.

use std::path::Path;
use std::process::{Command, Output};

use anyhow::Context;

use crate::verdict::{Verdict, judge_line};

/// The first argument that makes this program a `dsdf`.
pub const DSDF: &str = "dsdf";

/// The most bytes that a command may print.
const MOST_PRINTED: usize = 64 << 10;

/// Runs a command of `dsdf` in `folder`, and judges its exit status and its output.
///
/// # Errors
/// If this program cannot be started.
pub(crate) fn judge_command(folder: &Path, arguments: &[&str]) -> anyhow::Result<Verdict> {
    let program = std::env::current_exe().context("the path of this program")?;
    let mut command = Command::new(program);
    command.arg(DSDF).args(arguments).args(["--quiet", "--threads", "1"]).current_dir(folder);
    // A command that hangs ends with this process, which the driver of the campaign kills.
    command.arg(format!("--end-with={}", std::process::id()));
    Ok(judge_output(folder, &command.output()?))
}

fn judge_output(folder: &Path, output: &Output) -> Verdict {
    let printed = output.stdout.len() + output.stderr.len();
    if printed > MOST_PRINTED {
        return Verdict::Wrong(format!("{printed} bytes printed"));
    }
    let [text, errors] = [&output.stdout, &output.stderr].map(|b| String::from_utf8_lossy(b));
    let odd = |text: &str| text.chars().find(|c| c.is_control() && *c != '\n');
    if let Some(odd) = odd(&text).or_else(|| odd(&errors)) {
        return Verdict::Wrong(format!("control character {odd:?} printed: {text} {errors}"));
    }
    let lines: Vec<&str> = errors.lines().collect();
    match (output.status.code(), &lines[..]) {
        (Some(0), _) => Verdict::Accepted,
        // The program has paths as they were given: relative to the folder.
        (Some(2), [.., last]) => judge_line(folder, &format!("{}: {last}", folder.display())),
        (Some(1), [_]) => Verdict::Refused,
        (status, _) => Verdict::Wrong(format!("status {status:?}: {}", lines.join(" | "))),
    }
}
