#![doc = include_str!("../README.md")]
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program")]

mod arguments;
mod bench;
mod ci;
mod dist;
mod fuzz;
mod output;
mod record;
mod soak;
mod style;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use arguments::WrongArgument;

/// Development commands of dsdf
#[derive(Parser)]
struct Cli {
    #[command(subcommand)]
    command: Task,
}

/// The commands.
#[derive(Subcommand)]
enum Task {
    /// Check all: format, lints, documentation, tests, the Python package, sweeps on Slurm
    Ci,
    /// Check facts: layers of crates, promises of no I/O, paths and figures that pages quote
    Style,
    /// Measure the throughput of network passes and the time and memory of whole commands
    Bench {
        /// File for the results as JSON [default: target/bench.json, or target/workers.json]
        #[arg(short, long)]
        output: Option<PathBuf>,
        /// Simulate the iterations of a fit on this number of threads instead
        #[arg(long, value_name = "THREADS", value_parser = clap::value_parser!(u32).range(1..))]
        workers: Option<u32>,
    },
    /// Build a static binary of dsdf and a wheel for Python, and try both
    Dist(dist::Dist),
    /// Run a sweep: fits with different parameters, their errors, their gradients, and a report
    Ablate(sweep::Ablate),
    #[command(alias = "figures")]
    Record(record::Record),
    /// Read hostile files with every reader, in processes with limits of memory and time
    Fuzz(fuzz::Fuzz),
    /// Kill and resume a fit at random moments, and watch the memory of a long one
    Soak(soak::Soak),
}

/// Exit status 0 for success, 2 for wrong input, 1 for any other failure.
fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            eprintln!("{}", first_paragraph(&error.to_string()));
            return ExitCode::from(2);
        }
        Err(help) => {
            // A reader that closed the pipe is no error.
            let _ = help.print();
            return ExitCode::SUCCESS;
        }
    };
    match run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            let of_sweep = error.downcast_ref::<sweep::Error>().and_then(sweep::Error::input);
            let wrong = of_sweep.is_some() || error.is::<WrongArgument>();
            ExitCode::from(if wrong { 2 } else { 1 })
        }
    }
}

/// The first paragraph of a message in one line: refusals have one line, without the usage.
fn first_paragraph(message: &str) -> String {
    let words = message.split("\n\n").next().unwrap_or_default().split_whitespace();
    words.collect::<Vec<_>>().join(" ")
}

/// Calls the command.
fn run(cli: Cli) -> anyhow::Result<()> {
    match cli.command {
        Task::Ci => ci::run(),
        Task::Style => style::run(),
        Task::Dist(dist) => dist.run(),
        Task::Ablate(arguments) => Ok(sweep::run(&arguments)?),
        Task::Bench { output, workers: None } => bench::run(output),
        Task::Bench { output, workers: Some(workers) } => {
            bench::workers::run(workers as usize, output)
        }
        Task::Record(record) => record.run(),
        Task::Fuzz(fuzz) => fuzz.run(),
        Task::Soak(soak) => soak.run(),
    }
}
