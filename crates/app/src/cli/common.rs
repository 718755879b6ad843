//! Flags and output shared by the commands.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use clap::{Args, ValueEnum};
use field::{Real, Vector3};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use estimate::Registry;
use io::InputError;

/// Flags of every command.
#[derive(Args, Clone, Debug)]
pub(crate) struct Global {
    /// Print the result as one JSON object
    #[arg(long, global = true)]
    pub(crate) json: bool,
    /// Threads to use [default: all]
    #[arg(long, global = true, value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    /// No progress on standard error
    #[arg(long, global = true)]
    pub(crate) quiet: bool,
    /// End when the process of this number ends, which started this one (Linux)
    #[arg(long, global = true, hide = true, value_name = "PID")]
    pub(crate) end_with: Option<u32>,
    /// The estimators.
    #[arg(skip)]
    pub(crate) registry: Registry,
}

impl Global {
    /// Prints a result: as JSON, or as the lines of `text`.
    pub(crate) fn report(
        &self,
        json: &impl Serialize,
        text: impl FnOnce() -> String,
    ) -> anyhow::Result<()> {
        let line = if self.json { serde_json::to_string(json)? } else { text() };
        match writeln!(std::io::stdout(), "{line}") {
            // A reader that closes the pipe is no error.
            Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
                Err(error).context("standard output")
            }
            _ => Ok(()),
        }
    }

    /// A progress bar over fractions, on standard error.
    pub(crate) fn progress(&self, name: &str) -> ProgressBar {
        if self.quiet {
            return ProgressBar::hidden();
        }
        let style = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} % {eta} left");
        let bar = ProgressBar::new(1000).with_message(name.to_owned());
        match style {
            Ok(style) => bar.with_style(style),
            Err(_) => bar,
        }
    }
}

/// A callback that moves `bar` to a fraction.
pub(crate) fn mover(bar: &ProgressBar) -> impl Fn(f64) + Sync + '_ {
    |fraction| bar.set_position((fraction.min(1.0) * 1000.0) as u64)
}

/// Floating-point precision of a computation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PrecisionArg {
    /// Single precision
    F32,
    /// Double precision
    F64,
}

/// A colour of a scene in the precision of the computation.
pub(crate) fn color<R: Real>(rgb: [f64; 3]) -> R::Vec3 {
    R::Vec3::of(rgb.into())
}

/// Refuses an output whose extension is not among `extensions`.
pub(crate) fn check_extension(path: &Path, extensions: &[&str]) -> Result<(), InputError> {
    let found = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    if extensions.contains(&found.as_str()) {
        return Ok(());
    }
    let expected: Vec<String> = extensions.iter().map(|e| format!(".{e}")).collect();
    Err(InputError::new(path, "output", format!("extension \"{found}\""), expected.join(", ")))
}

/// An error of options on the command line, whose names are the flags'.
pub(super) fn option_error(name: &str, found: String, expected: &str) -> InputError {
    InputError::new(ARGUMENTS, format!("--{}", name.replace('_', "-")), found, expected)
}

/// The file that messages about flags name.
pub(super) const ARGUMENTS: &str = "arguments";
