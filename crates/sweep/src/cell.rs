//! One cell: a fit, its evaluation, its picture, and the test of its gradients.
//!
//! Every stage leaves a file in the cell's folder. A stage whose file is there is not run again.

use std::path::Path;

use crate::error::{Error, ProcessFailure};
use crate::report::Cell;
use crate::report::files::write_whole;
use crate::report::results::{CellResult, finished};
use serde_json::Value;

use crate::fit_metrics::add_fit_metrics;
use crate::fit_stage::wait_for_fit;
use crate::process::StageError;
use crate::runner::{CellRunner, text};

/// Width and height of a cell's picture, in pixels.
const PICTURE: &str = "96";

/// Numbers of the evaluation's report, with the metrics that they become.
const EVALUATED: [(&str, &str); 6] = [
    ("chamfer_relative", "chamfer"),
    ("psnr", "psnr"),
    ("ssim", "ssim"),
    ("mask_iou", "mask_iou"),
    ("f_score", "f_score"),
    ("normal_error", "normal_error"),
];

impl CellRunner<'_> {
    /// Runs the remaining stages of a cell. `watch` gets the finished fraction of the fit.
    ///
    /// # Errors
    /// If files cannot be written, or if the machine fails. A failure of the cell itself is its
    /// result.
    pub(crate) fn run(&self, cell: &Cell, watch: &dyn Fn(f64)) -> Result<CellResult, Error> {
        let folder = self.folder(cell);
        if let Some(result) = finished(&folder) {
            return Ok(result);
        }
        std::fs::create_dir_all(&folder).map_err(Error::file(&folder))?;
        let mut result = CellResult::new(self.sweep, cell);
        match self.measure(cell, &folder, &mut result, watch) {
            Ok(()) => {}
            Err(StageError::Cell(failure)) => {
                (result.status, result.reason) = (failure.status.to_owned(), failure.reason);
            }
            Err(StageError::Sweep(error)) => return Err(error),
        }
        let has_truth = self.sweep.data[cell.data].has_truth();
        result.converged = result.meets(&self.sweep.converged, has_truth);
        write_whole(
            &folder.join("result.json"),
            serde_json::to_vec_pretty(&result).map_err(Error::content)?,
        )?;
        Ok(result)
    }

    /// Runs the stages in their order, and adds their numbers to the result.
    fn measure(
        &self,
        cell: &Cell,
        folder: &Path,
        result: &mut CellResult,
        watch: &dyn Fn(f64),
    ) -> Result<(), StageError> {
        let run = folder.join("run");
        let fitted = self.fit(cell, folder, &run, watch);
        // The losses of a failed fit up to its end are part of its result.
        if !matches!(fitted, Err(StageError::Sweep(_))) {
            add_fit_metrics(&run, result);
        }
        fitted?;
        self.evaluate(cell, folder, &run, result)?;
        self.render(folder, &run)?;
        if self.sweep.gradient.runs == 0 {
            return Ok(());
        }
        let first = folder.join("first");
        self.fit_first_iterate(cell, folder, &first)?;
        for (name, run) in [("first", &first), ("last", &run)] {
            let [bias, variance] = self
                .gradients(cell, folder, name, run)
                .map_err(|error| gradient_failure(name, error))?;
            result.numbers.insert(format!("{name}_bias"), bias);
            result.numbers.insert(format!("{name}_variance"), variance);
        }
        Ok(())
    }

    /// Compares the fit with held-out views and with the true surface.
    fn evaluate(
        &self,
        cell: &Cell,
        folder: &Path,
        run: &Path,
        result: &mut CellResult,
    ) -> Result<(), StageError> {
        let resolution = format!("--resolution={}", self.sweep.mesh_resolution);
        let mut arguments = vec!["eval".to_owned(), text(run), resolution, self.threads()];
        let truth = &self.data[cell.data].truth;
        arguments.extend(truth.iter().map(|path| format!("--mesh={}", text(path))));
        let report = self.stage(folder, "eval", &arguments)?;
        for (from, to) in EVALUATED {
            result.numbers.extend(report[from].as_f64().map(|v| (to.to_owned(), v)));
        }
        Ok(())
    }

    /// Renders the cell's picture.
    fn render(&self, folder: &Path, run: &Path) -> Result<(), StageError> {
        let picture = text(&folder.join("picture.png"));
        let mut arguments = vec!["render".to_owned(), text(run), "-o".to_owned(), picture];
        arguments.extend(["--views", "1", "--size", PICTURE, &self.threads()].map(str::to_owned));
        self.stage(folder, "picture", &arguments)?;
        Ok(())
    }

    /// Fits one iteration, for the gradient test on the first iterate.
    fn fit_first_iterate(
        &self,
        cell: &Cell,
        folder: &Path,
        first: &Path,
    ) -> Result<(), StageError> {
        // A killed sweep may have left an unfinished run: without its report it is run again.
        if stage_report(folder, "first").is_none() && first.exists() {
            wait_for_fit(first)?;
            std::fs::remove_dir_all(first)?;
        }
        let mut arguments = self.fit_arguments(cell, first, &[]);
        arguments.push("--stop-after=1".to_owned());
        self.stage(folder, "first", &arguments)?;
        Ok(())
    }

    /// Runs a command once: its report is kept in `NAME.json`, and read from there afterwards.
    fn stage(&self, folder: &Path, name: &str, arguments: &[String]) -> Result<Value, StageError> {
        if let Some(report) = stage_report(folder, name) {
            return Ok(report);
        }
        let report = self.command(folder, name, arguments)?;
        write_whole(&folder.join(format!("{name}.json")), report.to_string())?;
        Ok(report)
    }
}

/// The report of a finished stage; `None` if its file is missing or cut short.
fn stage_report(folder: &Path, name: &str) -> Option<Value> {
    let text = std::fs::read_to_string(folder.join(format!("{name}.json"))).ok()?;
    serde_json::from_str(&text).ok().filter(Value::is_object)
}

/// Tells a failed gradient test, which is the cell's result, from a fault of the machine.
fn gradient_failure(name: &str, error: Error) -> StageError {
    if error.is_fault() {
        return StageError::Sweep(error);
    }
    let status = if let Error::Process(failure) = &error { failure.status } else { "failed" };
    let error = error.with_cause();
    let reason = format!("gradient of the {name} iterate: {error}").replace('\n', " ");
    ProcessFailure { status, reason }.into()
}
