//! Makes a variant of a data set of renders: the same object before another background.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program")]

use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use files::WriteError;
use indicatif::{ProgressBar, ProgressStyle};

use tests::compose::{Kind, compose};

/// Make a variant of a data set of renders: the same object before another background
#[derive(Parser)]
#[command(name = "compose")]
struct Arguments {
    /// The kind of the variant
    kind: Kind,
    /// The renders: a data set with masks or alpha channels, before one colour
    dataset: PathBuf,
    /// A new or empty folder for the variant
    out: PathBuf,
    /// Seed of the backgrounds and exposures
    #[arg(long, default_value_t = 0, allow_negative_numbers = true)]
    seed: u64,
}

/// Exit status 0 for success, 2 for wrong arguments or wrong input, 1 for any other failure.
fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) if error.use_stderr() => {
            let text = error.to_string();
            let first = text.split("\n\n").next().unwrap_or_default().split_whitespace();
            eprintln!("{}", files::printable(&first.collect::<Vec<_>>().join(" ")));
            return ExitCode::from(2);
        }
        Err(help) => {
            // A reader that closed the pipe is no error.
            let _ = help.print();
            return ExitCode::SUCCESS;
        }
    };
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", files::printable(&line(&error).replace('\n', " ")));
            ExitCode::from(if error.input().is_some() { 2 } else { 1 })
        }
    }
}

/// An error and its causes.
fn line(error: &dyn Error) -> String {
    let mut line = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        line += &format!(": {error}");
        cause = error.source();
    }
    line
}

fn run(arguments: &Arguments) -> Result<(), WriteError> {
    let style = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} % {eta} left")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(1000).with_style(style).with_message("views");
    let Arguments { kind, dataset, out, seed } = arguments;
    let result = compose(*kind, dataset, out, *seed, &mut |p| bar.set_position((1e3 * p) as u64));
    bar.finish_and_clear();
    result?;
    println!("{}", files::printable(&out.display().to_string()));
    Ok(())
}
