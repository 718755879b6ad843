//! Flags, output and errors that the commands share.

use std::ffi::OsStr;
use std::path::Path;

use anyhow::Context;
use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::messages::{Console, Progress};
use dataset::Dataset;
use estimate::Registry;
use files::{InputError, check_memory, check_output, check_output_folder, is_hidden, printable};
use fit::{Model, RunCameras, RunExposures, RunFile, align, match_exposures};

pub(super) use files::ARGUMENTS;

/// Flags of every command.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Options of every command")]
pub(crate) struct Global {
    /// Print the result as one JSON object
    #[arg(long, global = true)]
    pub(crate) json: bool,
    /// Number of threads, 1 to 1024 [default: all]
    #[arg(long, global = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Show no progress and no warnings on standard error
    #[arg(long, global = true)]
    pub(crate) quiet: bool,
    /// End when the parent process, which has this number, ends (Linux)
    #[arg(long, global = true, hide = true, value_name = "PID")]
    pub(crate) end_with: Option<u32>,
    /// The estimators that `--estimator` can name.
    #[arg(skip)]
    pub(crate) registry: Registry,
    /// The receiver of output and progress.
    #[arg(skip)]
    pub(crate) console: Console,
}

impl Global {
    /// Prints a result to standard output: `json` as one line with `--json` and in a host, else
    /// `text`.
    pub(crate) fn report(
        &self,
        json: &impl Serialize,
        text: impl FnOnce() -> String,
    ) -> anyhow::Result<()> {
        let line = if self.json || self.console.is_hosted() {
            escaped(&serde_json::to_string(json)?)
        } else {
            text().lines().map(printable).collect::<Vec<_>>().join("\n")
        };
        self.console.result(&line).context("cannot write to standard output")
    }

    /// Checks before the work that an output file can be written, and that its extension is one of
    /// `extensions` (lower case, without the dot). After Ctrl-C, no temporary file stays beside it.
    ///
    /// # Errors
    /// If it cannot.
    pub(crate) fn will_write(&self, path: &Path, extensions: &[&str]) -> anyhow::Result<()> {
        check_extension(path, extensions)?;
        check_output(path)?;
        self.console.clean(path.parent().unwrap_or(Path::new("")));
        Ok(())
    }

    /// Checks before the work that files can be written in a folder, which may not exist yet.
    /// After Ctrl-C, no temporary file stays in it and in its subfolders `inside`.
    ///
    /// # Errors
    /// If they cannot.
    pub(crate) fn will_write_in(&self, folder: &Path, inside: &[&str]) -> anyhow::Result<()> {
        check_output_folder(folder)?;
        self.console.clean(folder);
        inside.iter().for_each(|name| self.console.clean(&folder.join(name)));
        Ok(())
    }

    /// Prints a line about the progress to standard error, unless `--quiet` is given.
    pub(crate) fn say(&self, line: &str) {
        if !self.quiet {
            self.console.line(line);
        }
    }

    /// The progress of a command on standard error: a bar on a terminal, else a line about every
    /// ten seconds; nothing with `--quiet`.
    pub(crate) fn progress(&self, name: &str) -> Progress {
        self.console.progress(name, "{msg} {wide_bar} {percent:>3} % {eta} left", self.quiet)
    }

    /// The same for a step whose progress has a text.
    pub(crate) fn progress_with_text(&self, name: &str) -> Progress {
        self.console.progress(name, "{wide_bar} {percent:>3} % {eta} left  {msg}", self.quiet)
    }
}

/// JSON with the escapes of all characters that could change a terminal.
///
/// `serde_json` escapes those below U+0020. The others can only be in strings.
fn escaped(json: &str) -> String {
    let shown = |c| if is_hidden(c) { format!("\\u{:04x}", u32::from(c)) } else { String::from(c) };
    json.chars().map(shown).collect()
}

/// Floating-point precision of a computation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PrecisionArg {
    /// Single precision
    F32,
    /// Double precision
    F64,
}

/// Checks that the extension of an output file is one of `extensions`.
fn check_extension(path: &Path, extensions: &[&str]) -> Result<(), InputError> {
    let found = files::extension(path);
    if extensions.contains(&found.as_str()) {
        return Ok(());
    }
    let expected: Vec<String> = extensions.iter().map(|e| format!(".{e}")).collect();
    Err(InputError::new(path, "output", format!("extension \"{found}\""), expected.join(", ")))
}

/// Refuses images beyond the memory before they are computed. `file` and `field` are the place of
/// their size, and `bytes_per_pixel` is the memory of each pixel.
pub(crate) fn check_film(
    file: &Path,
    field: &str,
    [width, height]: [u32; 2],
    images: u64,
    bytes_per_pixel: u64,
) -> Result<(), InputError> {
    let found = match images {
        1 => format!("{width} x {height} pixels"),
        n => format!("{n} images of {width} x {height} pixels"),
    };
    let pixels = u64::from(width) * u64::from(height);
    let bytes = pixels.saturating_mul(images).saturating_mul(bytes_per_pixel);
    check_memory(file, field, found, bytes)
}

/// Bytes of memory for each pixel of an image that is rendered and written. Measured, of images of
/// 2500 × 2500 pixels: 33 for .png and .npy, 35 for .exr.
pub(crate) const RENDER_BYTES: u64 = 64;

/// The error of an option of a library, with its flag in place of its name.
pub(super) fn with_flag(mut error: InputError) -> InputError {
    if error.file == Path::new(ARGUMENTS) && !error.field.starts_with("--") {
        error.field = flag(&error.field);
    }
    error
}

/// The error of an option. The option `top_k` of a library has the flag `--top-k`.
pub(super) fn option_error(name: &str, found: String, expected: &str) -> InputError {
    InputError::new(ARGUMENTS, flag(name), found, expected)
}

fn flag(name: &str) -> String {
    format!("--{}", name.replace('_', "-"))
}

/// The arguments of a command that another one runs, from the words after its name.
pub(super) fn arguments<'a, T: Args>(
    words: impl IntoIterator<Item = &'a OsStr>,
) -> Result<T, clap::Error> {
    let command = T::augment_args(clap::Command::new("dsdf").no_binary_name(true));
    T::from_arg_matches(&command.try_get_matches_from(words)?)
}

/// The origin of the bounding sphere of a run that exists.
pub(super) const FROM_RUN: &str = "from the run";

/// Gives the training views of a data set the cameras of a run, and returns whether the run has
/// cameras of its own.
///
/// If the data set is another one than the run's (`is_other`), and the files lack a training view,
/// all training views stay as they are.
///
/// # Errors
/// If the file of the cameras cannot be used, or lacks a training view of the run's own data set.
pub(super) fn with_fitted_cameras(
    run: &Path,
    file: &RunFile,
    dataset: &mut Dataset,
    is_other: bool,
) -> anyhow::Result<bool> {
    let cameras = RunCameras::load(run)?;
    if let Some(cameras) = cameras.as_ref().filter(|all| !is_other || all.has_views_of(dataset)) {
        cameras.apply(dataset, file.origin(), run)?;
    }
    Ok(cameras.is_some())
}

/// Gives held-out views the cameras that suit a model best: the given ones are in the world as it
/// was before the refinement.
///
/// # Errors
/// If the field or a gradient is not finite.
pub(super) fn align_held_out(
    model: &Model,
    file: &RunFile,
    dataset: &mut Dataset,
    global: &Global,
) -> anyhow::Result<()> {
    let bar = global.progress("cameras");
    let cameras = align(model, file, &dataset.test, &bar.mover())?;
    bar.finish_and_clear();
    dataset.test.iter_mut().zip(cameras).for_each(|(view, camera)| view.camera = camera);
    global.say("cameras: those of the held-out views are aligned to the model first");
    Ok(())
}

/// Gives the views of a data set the cameras and exposures of a run, if it fitted any: training
/// photographs those of the run's files, held-out ones those that suit its model best.
///
/// If the data set is another one than the run's, and the files lack a training view, all training
/// views stay as they are.
///
/// # Errors
/// If a file of the run cannot be used, or the field or a gradient is not finite.
pub(crate) fn as_fitted(
    run: &Path,
    model: &Model,
    file: &RunFile,
    dataset: &mut Dataset,
    is_other: bool,
    global: &Global,
) -> anyhow::Result<()> {
    let is_refined = with_fitted_cameras(run, file, dataset, is_other)?;
    let exposures = RunExposures::load(run)?;
    if let Some(exposures) = &exposures {
        if !is_other || exposures.has_views_of(dataset) {
            exposures.apply(dataset, run)?;
        }
        let bar = global.progress("exposures");
        match_exposures(model, file, &mut dataset.test, &bar.mover())?;
        bar.finish_and_clear();
        global.say("exposures: those of the held-out photographs are matched to the model first");
    }
    if !is_refined || dataset.test.is_empty() {
        return Ok(());
    }
    align_held_out(model, file, dataset, global)?;
    if exposures.is_some() {
        // With the cameras as given, a bright part may have stood beside its place.
        match_exposures(model, file, &mut dataset.test, &|_| {})?;
    }
    Ok(())
}
