//! One cell: a fit, what it is worth, and how good its gradients are. Every stage leaves a file,
//! and is not done again.

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde_json::Value;

use super::process::{self, Failure};
use super::results::{Row, finished, write};
use super::sweep::{Cell, Sweep};
use super::tables::Limits;

/// What all cells share.
pub(super) struct Bench<'a> {
    pub(super) sweep: &'a Sweep,
    /// The program that fits.
    pub(super) binary: &'a Path,
    /// The folder of each data set, with its true surface.
    pub(super) data: &'a [(PathBuf, Option<PathBuf>)],
    /// The folder of the cells.
    pub(super) cells: PathBuf,
    /// Threads of one cell.
    pub(super) threads: usize,
}

/// Pixels of a cell's picture along a side.
const PICTURE: &str = "96";

/// Parts of a fit over which losses are averaged.
const WINDOWS: usize = 20;

impl Bench<'_> {
    pub(super) fn folder(&self, cell: &Cell) -> PathBuf {
        self.cells.join(&cell.name)
    }

    /// Runs what is left of a cell; `watch` is told the fraction of the fit that is done.
    ///
    /// # Errors
    /// If files cannot be written. What goes wrong in the cell itself is its result.
    pub(super) fn run(&self, cell: &Cell, watch: &dyn Fn(f64)) -> anyhow::Result<Row> {
        let folder = self.folder(cell);
        if let Some(row) = finished(&folder) {
            return Ok(row);
        }
        std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let mut row = Row::new(self.sweep, cell);
        if let Err(failure) = self.measure(cell, &folder, &mut row, watch)? {
            (row.status, row.reason) = (failure.status.to_owned(), failure.reason);
        }
        row.converged = self.sweep.converged.holds(&row, self.sweep.data[cell.data].has_truth());
        write(&folder.join("result.json"), serde_json::to_vec_pretty(&row)?)?;
        Ok(row)
    }

    fn measure(
        &self,
        cell: &Cell,
        folder: &Path,
        row: &mut Row,
        watch: &dyn Fn(f64),
    ) -> anyhow::Result<Result<(), Failure>> {
        let fit = folder.join("run");
        if let Err(failure) = self.fit(cell, folder, &fit, watch)? {
            // How far it came is part of the result.
            losses(&fit, row);
            return Ok(Err(failure));
        }
        losses(&fit, row);
        let truth = &self.data[cell.data].1;
        let mut arguments =
            vec!["eval".to_owned(), text(&fit), "--resolution=128".to_owned(), self.threads()];
        arguments.extend(truth.iter().map(|path| format!("--mesh={}", text(path))));
        match self.stage(folder, "eval", &arguments)? {
            Err(failure) => return Ok(Err(failure)),
            Ok(report) => {
                for (from, to) in [
                    ("chamfer_relative", "chamfer"),
                    ("psnr", "psnr"),
                    ("ssim", "ssim"),
                    ("mask_iou", "mask_iou"),
                    ("f_score", "f_score"),
                ] {
                    row.numbers.extend(report[from].as_f64().map(|v| (to.to_owned(), v)));
                }
            }
        }
        let picture = text(&folder.join("picture.png"));
        let views = ["--views", "1", "--size", PICTURE, &self.threads()].map(str::to_owned);
        let arguments =
            [vec!["render".to_owned(), text(&fit), "-o".to_owned(), picture], views.to_vec()]
                .concat();
        if let Err(failure) = self.stage(folder, "picture", &arguments)? {
            return Ok(Err(failure));
        }
        let first = folder.join("first");
        // The report is written last, so what a killed sweep left of it is done again.
        if stage_report(folder, "first").is_none() && first.exists() {
            wait_for(&first)?;
            std::fs::remove_dir_all(&first)?;
        }
        let arguments =
            [self.fit_arguments(cell, &first, &[]), vec!["--stop-after=1".to_owned()]].concat();
        if let Err(failure) = self.stage(folder, "first", &arguments)? {
            return Ok(Err(failure));
        }
        for (name, run) in [("first", &first), ("last", &fit)] {
            match self.gradients(cell, folder, name, run) {
                Ok([bias, variance]) => {
                    row.numbers.insert(format!("{name}_bias"), bias);
                    row.numbers.insert(format!("{name}_variance"), variance);
                }
                // A full disk is no result.
                Err(error) if process::is_fault(&error) => return Err(error),
                Err(error) => {
                    let status =
                        error.downcast_ref::<Failure>().map_or("failed", |failure| failure.status);
                    let reason =
                        format!("gradient of the {name} iterate: {error:#}").replace('\n', " ");
                    return Ok(Err(Failure { status, reason }));
                }
            }
        }
        Ok(Ok(()))
    }

    /// Fits, or goes on from a checkpoint.
    fn fit(
        &self,
        cell: &Cell,
        folder: &Path,
        run: &Path,
        watch: &dyn Fn(f64),
    ) -> anyhow::Result<Result<Value, Failure>> {
        wait_for(run)?;
        let resume = run.join("checkpoint/state.safetensors").exists();
        let arguments = if resume {
            vec![
                "fit".to_owned(),
                "-o".to_owned(),
                text(run),
                "--resume".to_owned(),
                self.threads(),
            ]
        } else {
            if run.exists() {
                std::fs::remove_dir_all(run)?;
            }
            self.fit_arguments(cell, run, &[])
        };
        let metrics = run.join("metrics.jsonl");
        // What was spent before counts.
        let spent =
            if resume { last_line(&metrics)["seconds"].as_f64().unwrap_or(0.0) } else { 0.0 };
        // A second is left for what was done but for its report.
        let whole = self.sweep.limits.seconds;
        let limits = Limits { seconds: (whole - spent).max(1.0).min(whole), ..self.sweep.limits };
        let show = || watch(last_line(&metrics)["progress"].as_f64().unwrap_or(0.0));
        let result =
            process::run(self.binary, &arguments, &limits, &folder.join("fit.log"), &show)?;
        Ok(result.map_err(
            |failure| if failure.status == "time" { Failure::time(whole) } else { failure },
        ))
    }

    fn fit_arguments(&self, cell: &Cell, run: &Path, budget: &[String]) -> Vec<String> {
        let mut arguments =
            vec!["fit".to_owned(), text(&self.data[cell.data].0), "-o".to_owned(), text(run)];
        let flags = self.sweep.flags(cell).into_iter().filter(|f| {
            let of_budget = f.starts_with("--iterations=") || f.starts_with("--time=");
            !f.starts_with("--gradient-") && (budget.is_empty() || !of_budget)
        });
        arguments.extend(flags);
        arguments.extend(budget.iter().cloned());
        if self.sweep.setting(cell, "preview_every").is_none() {
            arguments.push("--preview-every=1000000000".to_owned());
        }
        arguments.push(self.threads());
        arguments
    }

    /// Seconds of a fit of a few iterations.
    pub(super) fn pilot(&self, cell: &Cell, iterations: u64) -> anyhow::Result<f64> {
        let folder = self.folder(cell);
        std::fs::create_dir_all(&folder)?;
        let arguments =
            self.fit_arguments(cell, &folder.join("run"), &[format!("--iterations={iterations}")]);
        let report = self.program(&folder, "fit", &arguments, &|| {})?;
        let report =
            report.map_err(|failure| anyhow::anyhow!("{}: {}", cell.name, failure.reason))?;
        report["seconds"].as_f64().context("seconds in the report")
    }

    pub(super) fn threads(&self) -> String {
        format!("--threads={}", self.threads)
    }

    /// A stage whose report is kept.
    fn stage(
        &self,
        folder: &Path,
        name: &str,
        arguments: &[String],
    ) -> anyhow::Result<Result<Value, Failure>> {
        if let Some(report) = stage_report(folder, name) {
            return Ok(Ok(report));
        }
        let report = self.program(folder, name, arguments, &|| {})?;
        if let Ok(report) = &report {
            write(&folder.join(format!("{name}.json")), report.to_string())?;
        }
        Ok(report)
    }

    fn program(
        &self,
        folder: &Path,
        name: &str,
        arguments: &[String],
        watch: &dyn Fn(),
    ) -> anyhow::Result<Result<Value, Failure>> {
        process::run(
            self.binary,
            arguments,
            &self.sweep.limits,
            &folder.join(format!("{name}.log")),
            watch,
        )
    }
}

/// The report that a stage left, if it is whole.
fn stage_report(folder: &Path, name: &str) -> Option<Value> {
    let text = std::fs::read_to_string(folder.join(format!("{name}.json"))).ok()?;
    serde_json::from_str(&text).ok().filter(Value::is_object)
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// Waits for a fit that a killed sweep may have left at work: what it does need not be done twice.
fn wait_for(run: &Path) -> anyhow::Result<()> {
    if let Ok(lock) = std::fs::File::open(run.join("lock")) {
        lock.lock()?;
    }
    Ok(())
}

/// The last whole line of a file of JSON lines.
fn last_line(path: &Path) -> Value {
    const TAIL: u64 = 4096;
    let tail = || {
        use std::io::{Read, Seek, SeekFrom};
        let mut file = std::fs::File::open(path).ok()?;
        let length = file.metadata().ok()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(TAIL))).ok()?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).ok()?;
        let text = String::from_utf8_lossy(&bytes).into_owned();
        text.lines().rev().find_map(|line| serde_json::from_str(line).ok())
    };
    tail().unwrap_or(Value::Null)
}

/// Losses, evaluations and time from the metrics of a fit, with the curve.
fn losses(run: &Path, row: &mut Row) {
    let text = std::fs::read_to_string(run.join("metrics.jsonl")).unwrap_or_default();
    let lines: Vec<Value> =
        text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    let Some(last) = lines.last() else { return };
    row.numbers.extend(last["seconds"].as_f64().map(|s| ("seconds".to_owned(), s)));
    row.numbers.insert("iterations".to_owned(), lines.len() as f64);
    for (from, to) in [
        ("value", "values"),
        ("gradient", "gradients"),
        ("hessian_vector", "hessian_vectors"),
        ("parameter", "parameters"),
    ] {
        let total = lines.iter().filter_map(|line| line["evaluations"][from].as_f64()).sum();
        row.numbers.insert(to.to_owned(), total);
    }
    let mean = |lines: &[Value]| {
        lines.iter().filter_map(|l| l["loss"].as_f64()).sum::<f64>() / lines.len() as f64
    };
    let window = lines.len().div_ceil(WINDOWS);
    row.curve = lines
        .chunks(window)
        .map(|part| (part[0]["iteration"].as_f64().unwrap_or(0.0), mean(part)))
        .collect();
    // Coarse images have other losses: only full-sized ones compare.
    let full: Vec<Value> = lines.iter().filter(|line| line["level"] == 0).cloned().collect();
    // From the end on: the last is of the last iterations.
    let windows: Vec<f64> = full.rchunks_exact(window).map(mean).collect();
    if let Some(end) = windows.first() {
        row.numbers.insert("loss".to_owned(), *end);
        row.numbers
            .insert("best_loss".to_owned(), windows.iter().copied().fold(f64::INFINITY, f64::min));
    }
}
