//! The command line: parses the arguments, runs one command, returns the exit status.

mod cameras;
mod common;
mod cut;
mod demo;
mod eval;
mod export;
mod fit;
mod gradient;
mod inspect;
mod mesh;
mod poses;
mod preset;
mod query;
mod render;
mod report;
mod scan;
mod synth;

use std::ffi::OsString;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

use crate::messages::{Console, Host};
use estimate::Registry;

use crate::error::{Interrupted, WrongArguments, error_line, exit_status};

/// Reconstruct shapes from posed photographs by differentiable rendering of neural signed distance
/// fields
#[derive(Parser)]
#[command(name = "dsdf", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    global: common::Global,
}

#[derive(Subcommand)]
enum Command {
    /// Render a scene, or the object of a run from all sides, to an image
    Render(render::Render),
    /// Compute the derivative of a scene's image, or the gradient of an image loss
    ///
    /// With --wrt, the result is the derivative image d(pixel)/d(number), height × width × 3.
    /// With --target, it is the gradient of the loss ½ Σ (I − target)² over all pixels and channels
    /// by all weights of a neural scene.
    Gradient(gradient::Gradient),
    /// Reconstruct a shape from posed photographs
    ///
    /// The run folder gets model.safetensors, fit.toml (all options), metrics.jsonl (one line per
    /// iteration), checkpoint/ and preview/. Ctrl-C writes a checkpoint and stops; --resume
    /// continues the run.
    ///
    /// Before the first iteration, standard error gets a summary of the photographs and the
    /// warnings of `dsdf inspect`. At the end, the result has a verdict: the most likely fault, and
    /// the option to try. `dsdf inspect RUN` gives it again.
    Fit(Box<fit::Fit>),
    /// Render a data set of posed images of a scene, and write its true mesh
    Synth(synth::Synth),
    /// Show the cameras, units and bounding sphere of a data set, or the verdict on a run
    ///
    /// The verdict names the most likely fault of a run and the option to try. It follows from the
    /// surface (its area on the bounding sphere, and its area that no photograph sees) and from the
    /// PSNR on training and held-out views.
    Inspect(inspect::Inspect),
    /// Reconstruct an embedded example; needs no files
    Demo(demo::Demo),
    /// Extract the surface of a run as a mesh, in colour
    ///
    /// The colour of a vertex is the mean radiance towards the training cameras that see it; a
    /// vertex that none sees is grey. Colours are sRGB in .ply and .obj, and linear in .glb. A
    /// .usdz, which phones show, has a texture. The file is in the units of the data set; a .glb and a
    /// .usdz stand upright.
    Mesh(mesh::Mesh),
    /// Measure the errors of a run on held-out views, and against a true mesh
    Eval(eval::Eval),
    /// Evaluate the signed distance of a model file at points
    Query(query::Query),
    /// Find the camera poses of photographs by COLMAP, where it is installed
    ///
    /// COLMAP runs as a program of its own, on the CPU: features, matching, mapping, undistortion.
    /// The data set has the undistorted photographs and their poses. Ctrl-C stops; the same command
    /// continues. The output of COLMAP is in colmap.log.
    Poses(poses::Poses),
    /// Write a run as one page: surface, cameras, photographs beside renders, curves, verdict
    ///
    /// The page is one HTML file. It needs no network, and opens from the disk.
    Report(report::Report),
    /// Write the cameras of a run, as it refined them, as a data set for other programs
    ///
    /// The folder gets transforms.json in the form of nerfstudio, sparse/0 in the form of COLMAP, and
    /// the photographs as the fit read them: without distortion, at its size. Held-out views are
    /// aligned to the model first.
    Cameras(cameras::Cameras),
    /// Turn photographs into a mesh: poses, fit, mesh and page in one command
    ///
    /// The poses are those of `dsdf poses`, by COLMAP; a data set with poses needs none. The mesh is
    /// that of `dsdf mesh`, in colour, without the table and without what no photograph sees. Ctrl-C
    /// stops; the same command continues. A run keeps the time that it began with: `dsdf fit -o
    /// OUTPUT/run --resume --time TIME` gives it more.
    Scan(scan::Scan),
}

/// Runs `dsdf` and returns its exit status: 0 for success, 2 for wrong arguments or wrong input,
/// 130 after Ctrl-C, 1 for any other error.
///
/// `arguments` starts with the name of the program. Results go to standard output; progress and
/// errors, one line each, go to standard error.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    run_with(arguments, Registry::default())
}

/// Like [`run`], with the estimators of `registry`.
///
/// A program that adds an estimator to `dsdf` calls this function.
///
/// # Panics
/// If an estimator has the name `fd`, that of finite differences.
pub fn run_with(arguments: impl IntoIterator<Item = OsString>, registry: Registry) -> u8 {
    let fd = gradient::FINITE_DIFFERENCES;
    assert!(registry.get(fd).is_none(), "{fd:?} cannot be the name of an estimator");
    match parse_and_execute(arguments, registry, Console::default()) {
        Ok(()) => 0,
        Err(error) => {
            eprintln!("error: {}", error_line(&error));
            exit_status(&error)
        }
    }
}

/// Runs a command inside another program, which gets the result as JSON, lines and progress.
///
/// No handler of Ctrl-C is installed, and nothing is written to the standard streams but help.
///
/// # Errors
/// Those of the command; [`exit_status`] tells their kinds apart, and [`error_line`] has the text.
/// `Interrupted` if the host stopped the command.
pub fn run_in_host(
    arguments: impl IntoIterator<Item = OsString>,
    host: Arc<dyn Host>,
) -> anyhow::Result<()> {
    let console = Console::of_host(host);
    let run = || parse_and_execute(arguments, Registry::default(), console);
    match catch_unwind(AssertUnwindSafe(run)) {
        Ok(result) => result,
        Err(stopped) if stopped.is::<Interrupted>() => Err(Interrupted.into()),
        Err(panic) => resume_unwind(panic),
    }
}

fn parse_and_execute(
    arguments: impl IntoIterator<Item = OsString>,
    registry: Registry,
    console: Console,
) -> anyhow::Result<()> {
    match parse(arguments, registry) {
        Ok(mut cli) => {
            cli.global.console = console;
            execute(cli)
        }
        Err(error) if error.use_stderr() => {
            let text = error.to_string();
            let first = text.split("\n\n").next().unwrap_or_default();
            // Without a command, the text is the help.
            let message = first.strip_prefix("error:").unwrap_or("no command: see dsdf --help");
            Err(WrongArguments(message.split_whitespace().collect::<Vec<_>>().join(" ")).into())
        }
        Err(help) => {
            // A reader may close the pipe early. That is no error.
            let _ = help.print();
            Ok(())
        }
    }
}

/// Parses the arguments and resolves presets: an option that is not given takes the value of the
/// preset.
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

/// The definition of the command line.
///
/// The help of `--estimator` lists the registry.
fn command(registry: &Registry) -> clap::Command {
    let estimators = estimator_list(registry);
    let for_gradient = format!("{estimators}{}", gradient::FD_HELP);
    with_negative_numbers(Cli::command())
        .mut_subcommands(with_negative_numbers)
        .mut_subcommand("gradient", |command| with_estimator_help(command, &for_gradient))
        .mut_subcommand("fit", |command| with_estimator_help(command, &estimators))
}

/// The name and the summary of each estimator, one line each.
fn estimator_list(registry: &Registry) -> String {
    let line = |entry: &estimate::Entry| format!("- {}: {}", entry.name, entry.summary);
    registry.entries().iter().map(line).collect::<Vec<_>>().join("\n")
}

/// Appends a list of estimators to the help of `--estimator`.
fn with_estimator_help(command: clap::Command, list: &str) -> clap::Command {
    command.mut_arg("estimator", |arg| {
        let short = arg.get_help().map(ToString::to_string).unwrap_or_default();
        arg.long_help(format!("{short}:\n{list}"))
    })
}

/// Accepts "-1" as the value of an option, so that the error message is about the value and not
/// about an unknown flag.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    command.mut_args(|arg| {
        let valued = arg.get_action().takes_values();
        arg.allow_negative_numbers(valued)
    })
}

/// Ends this process when its parent ends, so that a killed sweep leaves no fit behind.
#[cfg(target_os = "linux")]
fn end_with(parent: Option<u32>) -> anyhow::Result<()> {
    use rustix::process::{Signal, getppid, set_parent_process_death_signal};
    let Some(parent) = parent else { return Ok(()) };
    set_parent_process_death_signal(Some(Signal::KILL))?;
    // The signal is not sent if the parent ended before this call.
    if getppid().is_none_or(|pid| pid.as_raw_nonzero().get() as u32 != parent) {
        anyhow::bail!("the parent process {parent} has ended");
    }
    Ok(())
}

#[cfg(not(target_os = "linux"))]
fn end_with(_parent: Option<u32>) -> anyhow::Result<()> {
    Ok(())
}

/// Runs a command on a pool of `--threads` threads.
fn execute(cli: Cli) -> anyhow::Result<()> {
    let global = cli.global;
    end_with(global.end_with)?;
    global.console.handle_interrupts()?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(global.threads.map_or(0, usize::from))
        .build()?;
    let result = pool.install(|| match cli.command {
        Command::Render(command) => command.run(&global),
        Command::Gradient(command) => command.run(&global),
        Command::Fit(command) => command.run(&global),
        Command::Synth(command) => command.run(&global),
        Command::Inspect(command) => command.run(&global),
        Command::Demo(command) => command.run(&global),
        Command::Mesh(command) => command.run(&global),
        Command::Eval(command) => command.run(&global),
        Command::Query(command) => command.run(&global),
        Command::Poses(command) => command.run(&global),
        Command::Report(command) => command.run(&global),
        Command::Cameras(command) => command.run(&global),
        Command::Scan(command) => command.run(&global),
    });
    global.console.close_site(&result);
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_its_own_defaults_of_the_warp() {
        let command = command(&Registry::default());
        let defaults = |name: &str| {
            let command = command.find_subcommand(name).unwrap();
            let default = |id: &str| {
                let arg = command.get_arguments().find(|arg| arg.get_id() == id).unwrap();
                arg.get_default_values()[0].to_str().unwrap().to_owned()
            };
            ["steps", "top_k", "gamma", "lambda_d", "epsilon"].map(default)
        };
        assert_eq!(defaults("gradient"), ["22", "14", "3", "1", "0.000001"]);
        assert_eq!(defaults("fit"), ["22", "7", "3", "0.02", "0.000001"]);
    }
}
