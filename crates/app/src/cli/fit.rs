//! `dsdf fit`.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{ArgMatches, Args};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::common::{ARGUMENTS, Global};
use super::preset::{Preset, is_explicit};
use crate::error::Interrupted;
use dataset::{Dataset, LoadOptions};
use fit::{Fit as Fitting, FitOptions, Metrics, RunFile};
pub(super) use fit::{parse_bounds, parse_duration};
use io::InputError;

/// Reconstruct a shape from posed photographs.
#[derive(Args, Debug)]
pub(crate) struct Fit {
    /// The data set: a folder in NeRF/Blender, NeuS/IDR, Middlebury or COLMAP form
    #[arg(required_unless_present_any = ["resume", "check"])]
    dataset: Option<PathBuf>,
    /// The run folder to write
    #[arg(short, long)]
    output: PathBuf,
    /// Go on from the checkpoint in the run folder, with the options it was started with
    #[arg(long)]
    resume: bool,
    /// Stop after this many iterations of the whole schedule; --resume goes on
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    stop_after: Option<u64>,
    /// Check the options, and do nothing
    #[arg(long)]
    check: bool,
    /// Speed/accuracy preset; explicit options override it
    #[arg(long, value_enum)]
    preset: Option<Preset>,
    #[command(flatten)]
    options: FitOptions,
}

#[derive(Serialize)]
pub(super) struct Report {
    run: PathBuf,
    iterations: u64,
    seconds: f64,
    loss: Option<f64>,
    psnr: Option<f64>,
}

impl Report {
    /// Iterations done.
    pub(super) fn iterations(&self) -> u64 {
        self.iterations
    }
}

impl Fit {
    /// Replaces the defaults of options that are not on the command line by the preset's values. A
    /// resumed run keeps its options.
    pub(super) fn resolve_preset(&mut self, matches: &ArgMatches) {
        let (iterations, width) = match self.preset {
            Some(Preset::Fast) => (2000, None),
            Some(Preset::Accurate) => (20_000, Some(96)),
            Some(Preset::Balanced) | None => return,
        };
        if self.resume {
            return;
        }
        if !is_explicit(matches, "iterations") && !is_explicit(matches, "time") {
            self.options.iterations = Some(iterations);
        }
        if let Some(width) = width.filter(|_| !is_explicit(matches, "width")) {
            self.options.width = width;
        }
    }

    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        if self.check {
            return self.validate(global);
        }
        let (dataset, file) =
            if self.resume { self.resumed(global)? } else { self.started(global)? };
        let when = When { resume: self.resume, stop_after: self.stop_after };
        let report = fit(dataset, file, &self.output, when, global)?;
        global.report(&report, || {
            let psnr = report.psnr.map_or(String::new(), |p| format!(", held-out PSNR {p:.2} dB"));
            format!(
                "{} iterations, {:.0} s{psnr}: {}",
                report.iterations,
                report.seconds,
                report.run.display()
            )
        })
    }

    fn validate(&self, global: &Global) -> anyhow::Result<()> {
        Ok(self.options.validate(Path::new(ARGUMENTS), &global.registry)?)
    }

    fn started(&self, global: &Global) -> anyhow::Result<(Dataset, RunFile)> {
        self.validate(global)?;
        let Some(path) = &self.dataset else {
            return Err(
                InputError::new(ARGUMENTS, "DATASET", "nothing", "a data set's folder").into()
            );
        };
        start(path, &self.options)
    }

    fn resumed(&self, global: &Global) -> anyhow::Result<(Dataset, RunFile)> {
        let mut file = RunFile::load(&self.output)?;
        // A resumed run may have a new budget, and no other new option.
        if self.options.time.is_some() || self.options.iterations.is_some() {
            (file.options.time, file.options.iterations) =
                (self.options.time, self.options.iterations);
        }
        let toml = self.output.join("fit.toml");
        file.options.validate(&toml, &global.registry)?;
        self.refuse_changes(&file, &toml)?;
        if let Some(path) = self.dataset.as_ref().filter(|p| absolute(p) != absolute(&file.dataset))
        {
            let expected = format!("{}, as the run was started with", file.dataset.display());
            return Err(InputError::new(toml, "dataset", path.display(), expected).into());
        }
        let dataset =
            dataset::load(&file.dataset, &LoadOptions { downscale: file.options.downscale })?;
        Ok((dataset, file))
    }
}

impl Fit {
    /// Refuses options that a resumed run would have to ignore.
    fn refuse_changes(&self, file: &RunFile, source: &Path) -> anyhow::Result<()> {
        let [given, default, kept] = [&self.options, &FitOptions::default(), &file.options]
            .map(|options| toml::Table::try_from(options).map(flat));
        let (given, default, kept) = (given?, default?, kept?);
        for (key, value) in given {
            let new = default.get(&key) != Some(&value) && kept.get(&key) != Some(&value);
            if new && key != "time" && key != "iterations" {
                let kept = kept.get(&key).map_or("nothing".to_owned(), ToString::to_string);
                let expected = format!("{kept}, as the run was started with");
                return Err(InputError::new(source, key, value, expected).into());
            }
        }
        Ok(())
    }
}

/// The entries of a table and of the tables in it, under their own keys.
fn flat(table: toml::Table) -> toml::Table {
    let entries = table.into_iter().flat_map(|(key, value)| match value {
        toml::Value::Table(inner) => inner.into_iter().collect::<Vec<_>>(),
        value => vec![(key, value)],
    });
    entries.collect()
}

/// A path that means the same from any folder.
fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// Loads a data set and settles its bounding sphere and background.
pub(super) fn start(path: &Path, options: &FitOptions) -> anyhow::Result<(Dataset, RunFile)> {
    let dataset = dataset::load(path, &LoadOptions { downscale: options.downscale })?;
    let (bounds, background) = dataset::surroundings(&dataset, options.bounds());
    dataset::check_cameras(&dataset, &bounds)?;
    let center = bounds.center;
    let file = RunFile {
        dataset: absolute(path),
        bounds: [center.x, center.y, center.z, bounds.radius],
        background: background.color,
        background_spread: background.spread,
        background_confidence: background.confidence,
        options: options.clone(),
    };
    Ok((dataset, file))
}

/// Makes the run's folders and its `fit.toml`.
fn prepare(run: &Path, file: &RunFile) -> anyhow::Result<()> {
    for folder in [run.to_owned(), run.join("checkpoint"), run.join("preview")] {
        std::fs::create_dir_all(&folder)
            .map_err(|e| InputError::new(&folder, "run", e, "a folder that can be written"))?;
    }
    file.save(run)
}

/// Where a fit starts and ends.
#[derive(Clone, Copy, Default)]
pub(super) struct When {
    /// At the checkpoint that is there.
    resume: bool,
    /// Before its budget is spent.
    stop_after: Option<u64>,
}

/// Fits a data set in a run folder, with progress, metrics, previews and checkpoints.
pub(super) fn fit(
    dataset: Dataset,
    file: RunFile,
    run: &Path,
    When { resume, stop_after }: When,
    global: &Global,
) -> anyhow::Result<Report> {
    if !resume && run.join("checkpoint/state.safetensors").exists() {
        let expected = "an empty folder, or --resume to go on";
        return Err(InputError::new(run, "run", "a run with a checkpoint", expected).into());
    }
    let mut claimed = if resume { Some(claim(run)?) } else { None };
    // Everything that can be refused is refused before a file is written.
    let mut fitting = Fitting::new(run, dataset, file, &global.registry, resume)?;
    if claimed.is_none() {
        std::fs::create_dir_all(run)
            .map_err(|e| InputError::new(run, "run", e, "a folder that can be written"))?;
        claimed = Some(claim(run)?);
    }
    prepare(run, &fitting.file)?;
    let stop = on_interrupt()?;
    let mut metrics = MetricsFile::open(&run.join("metrics.jsonl"), fitting.iteration)?;
    let bar = progress_bar(global);
    let mut last: Option<Metrics> = None;
    let done = std::cell::Cell::new(fitting.iteration);
    let stopped = || stop.load(Ordering::Relaxed) || stop_after.is_some_and(|n| done.get() >= n);
    fitting.run(&stopped, &mut |step| {
        done.set(step.iteration);
        metrics.write(step)?;
        show(&bar, step);
        last = Some(step.clone());
        Ok(())
    })?;
    bar.finish_and_clear();
    if stop.load(Ordering::Relaxed) {
        eprintln!("stopped after {} iterations; --resume goes on", fitting.iteration);
        return Err(Interrupted.into());
    }
    fitting.preview()?;
    drop(claimed);
    Ok(Report {
        run: run.to_owned(),
        iterations: fitting.iteration,
        seconds: fitting.seconds(),
        loss: last.map(|m| m.loss),
        psnr: fitting.held_out_psnr(),
    })
}

/// Takes a run folder for this process: two fits in one would spoil each other's files.
fn claim(run: &Path) -> anyhow::Result<std::fs::File> {
    let path = run.join("lock");
    let lock = std::fs::File::create(&path)
        .map_err(|e| InputError::new(&path, "lock", e, "a file to write"))?;
    match lock.try_lock() {
        Err(std::fs::TryLockError::WouldBlock) => {
            Err(InputError::new(run, "run", "a fit at work", "a folder of its own, or patience")
                .into())
        }
        // Where files cannot be locked, nobody is kept out.
        _ => Ok(lock),
    }
}

/// A flag that the first Ctrl-C raises; the second ends the program at once.
fn on_interrupt() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let raised = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if raised.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })?;
    Ok(stop)
}

/// `metrics.jsonl`, a line an iteration.
struct MetricsFile {
    file: std::io::BufWriter<std::fs::File>,
}

impl MetricsFile {
    /// Opens the file for appending, without the lines after `iteration` that a killed run left.
    fn open(path: &Path, iteration: u64) -> anyhow::Result<Self> {
        let kept: String = std::fs::read_to_string(path)
            .unwrap_or_default()
            .lines()
            .filter(|line| {
                let value: Option<serde_json::Value> = serde_json::from_str(line).ok();
                value.and_then(|v| v["iteration"].as_u64()).is_some_and(|i| i <= iteration)
            })
            .flat_map(|line| [line, "\n"])
            .collect();
        io::atomic_write(path, |out| Ok(out.write_all(kept.as_bytes())?))?;
        Ok(MetricsFile {
            file: std::io::BufWriter::new(OpenOptions::new().append(true).open(path)?),
        })
    }

    fn write(&mut self, metrics: &Metrics) -> anyhow::Result<()> {
        serde_json::to_writer(&mut self.file, metrics)?;
        self.file.write_all(b"\n")?;
        Ok(self.file.flush()?)
    }
}

fn progress_bar(global: &Global) -> ProgressBar {
    if global.quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(10_000);
    match ProgressStyle::with_template("{wide_bar} {percent:>3} % {eta} left  {msg}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

fn show(bar: &ProgressBar, m: &Metrics) {
    bar.set_position((m.progress.min(1.0) * 10_000.0) as u64);
    let psnr = m
        .psnr
        .map_or_else(|| format!("train {:.1} dB", m.train_psnr), |p| format!("held-out {p:.1} dB"));
    bar.set_message(format!("loss {:.4}  {psnr}  {:.0} k rays/s", m.loss, m.rays_per_second / 1e3));
}
