//! Development commands of dsdf: `cargo xtask ci`, `bench`, `ablate`, `tradeoff` and `figures`.

mod bench;
mod figures;
mod tradeoff;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use figures::Figure;
use measure::cargo;

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
    /// Measure what every pass of a network makes of this machine, and what whole commands take
    Bench {
        /// Where to write the JSON [default: target/bench.json]
        #[arg(short, long)]
        output: Option<PathBuf>,
    },
    /// Run a sweep over parameters: fits, their quality, their gradients, and a report
    Ablate(sweep::Ablate),
    /// Measure what each parameter costs and buys, and the presets
    Tradeoff {
        /// Where to write [default: docs/results/tradeoff]
        #[arg(short, long)]
        output: Option<PathBuf>,
    },
    /// Measure what the documentation shows, and write its tables and plots
    Figures {
        /// What to measure
        figure: Figure,
        /// Where to write [default: docs/results/FIGURE]
        #[arg(short, long)]
        output: Option<PathBuf>,
    },
}

/// Exit status 2 for what is refused, 1 for what fails.
fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            let text = error.to_string();
            let line: Vec<&str> =
                text.split("\n\n").next().unwrap_or_default().split_whitespace().collect();
            eprintln!("{}", line.join(" "));
            return ExitCode::from(2);
        }
        Err(help) => {
            // Whoever reads it may have read enough.
            let _ = help.print();
            return ExitCode::SUCCESS;
        }
    };
    match run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(if error.downcast_ref::<sweep::Refusal>().is_some() { 2 } else { 1 })
        }
    }
}

fn run(cli: Cli) -> anyhow::Result<()> {
    match cli.command {
        Task::Ci => ci(),
        Task::Ablate(arguments) => sweep::run(&arguments),
        Task::Bench { output } => bench::run(output),
        Task::Tradeoff { output } => tradeoff::run(output),
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
