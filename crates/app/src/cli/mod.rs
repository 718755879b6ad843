//! The command line: arguments in, exit status out.

mod common;
mod demo;
mod eval;
mod fit;
mod gradient;
mod inspect;
mod mesh;
mod preset;
mod query;
mod render;
mod synth;
mod weights;

use std::ffi::OsString;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

use crate::error::exit_status;
pub use weights::Weights;

/// Differentiable rendering of neural signed distance fields: posed photographs in, a shape out.
#[derive(Parser)]
#[command(name = "dsdf", version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    global: common::Global,
}

#[derive(Subcommand)]
enum Command {
    /// Render a scene to an image (.png, .exr or .npy)
    Render(render::Render),
    /// Differentiate a scene's image by one of its numbers, or a loss by a network's weights
    Gradient(gradient::Gradient),
    /// Reconstruct a shape from posed photographs
    Fit(fit::Fit),
    /// Make a data set of posed images of a scene, with exact ground truth
    Synth(synth::Synth),
    /// Show what was understood of a data set
    Inspect(inspect::Inspect),
    /// The main job on an embedded example: no files needed
    Demo(demo::Demo),
    /// Extract a run's surface as a mesh
    Mesh(mesh::Mesh),
    /// Measure a run on held-out views, and against a mesh
    Eval(eval::Eval),
    /// Evaluate a model file at points
    Query(query::Query),
}

/// Runs the program on its arguments and returns the exit status: 0 done, 2 for wrong arguments or
/// input, 130 after Ctrl-C, 1 for anything else.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    run_with(arguments, None)
}

/// The same for a program that brings weights of its own.
pub fn run_with(arguments: impl IntoIterator<Item = OsString>, weights: Option<Weights>) -> u8 {
    let command = with_negative_numbers(Cli::command()).mut_subcommands(with_negative_numbers);
    let parsed = command
        .try_get_matches_from(preset::expand(arguments.into_iter().collect()))
        .and_then(|matches| Cli::from_arg_matches(&matches));
    let cli = match parsed {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            let text = error.to_string();
            let line: Vec<&str> =
                text.split("\n\n").next().unwrap_or_default().split_whitespace().collect();
            eprintln!("{}", line.join(" "));
            return 2;
        }
        Err(help) => {
            // Whoever reads it may have read enough.
            let _ = help.print();
            return 0;
        }
    };
    match execute(cli, weights) {
        Ok(()) => 0,
        Err(error) => {
            let chain: Vec<String> =
                error.chain().map(|e| e.to_string().replace('\n', " ")).collect();
            eprintln!("error: {}", chain.join(": "));
            exit_status(&error)
        }
    }
}

/// Ends this process when its parent does: what is started a thousand times should not be left
/// behind once.
#[cfg(target_os = "linux")]
fn end_with(parent: Option<u32>) -> anyhow::Result<()> {
    use rustix::process::{Signal, getppid, set_parent_process_death_signal};
    let Some(parent) = parent else { return Ok(()) };
    set_parent_process_death_signal(Some(Signal::KILL))?;
    // It may have ended before.
    if getppid().is_none_or(|pid| pid.as_raw_nonzero().get() as u32 != parent) {
        anyhow::bail!("process {parent} has ended");
    }
    Ok(())
}

#[cfg(not(target_os = "linux"))]
fn end_with(_parent: Option<u32>) -> anyhow::Result<()> {
    Ok(())
}

/// "-1" is a value to be judged, not an unknown flag.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    command.mut_args(|arg| {
        let valued = arg.get_action().takes_values();
        arg.allow_negative_numbers(valued)
    })
}

fn execute(cli: Cli, weights: Option<Weights>) -> anyhow::Result<()> {
    let global = common::Global { weights, ..cli.global };
    end_with(global.end_with)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(global.threads.map_or(0, usize::from))
        .build()?;
    pool.install(|| match cli.command {
        Command::Render(command) => command.run(&global),
        Command::Gradient(command) => command.run(&global),
        Command::Fit(command) => command.run(&global),
        Command::Synth(command) => command.run(&global),
        Command::Inspect(command) => command.run(&global),
        Command::Demo(command) => command.run(&global),
        Command::Mesh(command) => command.run(&global),
        Command::Eval(command) => command.run(&global),
        Command::Query(command) => command.run(&global),
    })
}
