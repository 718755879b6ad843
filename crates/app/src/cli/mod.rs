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

use std::ffi::OsString;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

use ::fit::FitOptions;
use estimate::Registry;

use crate::error::exit_status;

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
    /// Show the cameras, units and bounds that were read from a data set
    Inspect(inspect::Inspect),
    /// Reconstruct an embedded example; needs no files
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
    run_with(arguments, Registry::default())
}

/// Runs the program with the estimators of a registry: a program that adds an estimator of its own
/// calls this.
pub fn run_with(arguments: impl IntoIterator<Item = OsString>, registry: Registry) -> u8 {
    let cli = match parse(arguments, registry) {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            let text = error.to_string();
            let first = text.split("\n\n").next().unwrap_or_default();
            eprintln!("{}", first.split_whitespace().collect::<Vec<_>>().join(" "));
            return 2;
        }
        Err(help) => {
            // A reader that closes the pipe is no error.
            let _ = help.print();
            return 0;
        }
    };
    match execute(cli) {
        Ok(()) => 0,
        Err(error) => {
            let chain: Vec<String> =
                error.chain().map(|e| e.to_string().replace('\n', " ")).collect();
            eprintln!("error: {}", chain.join(": "));
            exit_status(&error)
        }
    }
}

/// The command line, with presets resolved: options that are not given take the preset's values.
fn parse(
    arguments: impl IntoIterator<Item = OsString>,
    registry: Registry,
) -> Result<Cli, clap::Error> {
    let matches = command(&registry).try_get_matches_from(arguments)?;
    let mut cli = Cli::from_arg_matches(&matches)?;
    cli.global.registry = registry;
    match (&mut cli.command, matches.subcommand()) {
        (Command::Gradient(gradient), Some((_, matches))) => gradient.resolve_preset(matches),
        (Command::Fit(fit), Some((_, matches))) => fit.resolve_preset(matches),
        _ => {}
    }
    Ok(cli)
}

/// The command line's definition: estimators are those of the registry, and `fit` has its own
/// defaults of the warp.
fn command(registry: &Registry) -> clap::Command {
    let estimators: Vec<String> = registry
        .entries()
        .iter()
        .map(|entry| format!("- {}: {}", entry.name, entry.summary))
        .collect();
    let estimators = estimators.join("\n");
    let with_estimators = |command: clap::Command, more: &str| {
        let help = format!("{estimators}{more}");
        command.mut_arg("estimator", |arg| {
            let short = arg.get_help().map(ToString::to_string).unwrap_or_default();
            arg.long_help(format!("{short}:\n{help}"))
        })
    };
    with_negative_numbers(Cli::command())
        .mut_subcommands(with_negative_numbers)
        .mut_subcommand("gradient", |command| with_estimators(command, gradient::FD_HELP))
        .mut_subcommand("fit", |command| {
            FitOptions::with_fit_defaults(with_estimators(command, ""))
        })
}

/// Ends this process when its parent ends, so that a sweep that is killed leaves no fit behind.
#[cfg(target_os = "linux")]
fn end_with(parent: Option<u32>) -> anyhow::Result<()> {
    use rustix::process::{Signal, getppid, set_parent_process_death_signal};
    let Some(parent) = parent else { return Ok(()) };
    set_parent_process_death_signal(Some(Signal::KILL))?;
    // The parent may have ended before.
    if getppid().is_none_or(|pid| pid.as_raw_nonzero().get() as u32 != parent) {
        anyhow::bail!("process {parent} has ended");
    }
    Ok(())
}

#[cfg(not(target_os = "linux"))]
fn end_with(_parent: Option<u32>) -> anyhow::Result<()> {
    Ok(())
}

/// Accepts "-1" as a value, so that the message is about the value and not about an unknown flag.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    command.mut_args(|arg| {
        let valued = arg.get_action().takes_values();
        arg.allow_negative_numbers(valued)
    })
}

fn execute(cli: Cli) -> anyhow::Result<()> {
    let global = cli.global;
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
