//! The fit of a cell: started, continued from a checkpoint, or cut short for an estimate of time.

use std::path::Path;

use crate::error::{Error, ProcessFailure};
use crate::report::Cell;
use crate::report::schema::Limits;
use serde_json::Value;

use crate::fit_metrics::last_line;
use crate::process::{self, StageError};
use crate::runner::{CellRunner, text};

/// The option that keeps a fit from rendering previews.
const NO_PREVIEWS: &str = "--preview-every=1000000000";

impl CellRunner<'_> {
    /// Fits into the folder `run`, or continues the fit there from its checkpoint. `watch` gets the
    /// finished fraction.
    pub(crate) fn fit(
        &self,
        cell: &Cell,
        folder: &Path,
        run: &Path,
        watch: &dyn Fn(f64),
    ) -> Result<Value, StageError> {
        wait_for_fit(run)?;
        let metrics = run.join("metrics.jsonl");
        let resume = run.join("checkpoint/state.safetensors").exists();
        let (arguments, spent) = if resume {
            let spent = last_line(&metrics)["seconds"].as_f64().unwrap_or(0.0);
            (self.resume_arguments(run), spent)
        } else {
            if run.exists() {
                std::fs::remove_dir_all(run)?;
            }
            (self.fit_arguments(cell, run, &[]), 0.0)
        };
        // The time before an interruption counts. At least a second is left, for a fit that had
        // only its report to write.
        let whole = self.sweep.limits.seconds;
        let limits = Limits { seconds: (whole - spent).max(1.0).min(whole), ..self.sweep.limits };
        let show = || watch(last_line(&metrics)["progress"].as_f64().unwrap_or(0.0));
        process::run(self.binary, &arguments, &limits, &folder.join("fit.log"), &show).map_err(
            |error| match error {
                StageError::Cell(failure) if failure.status == "time" => {
                    ProcessFailure::time(whole).into()
                }
                other => other,
            },
        )
    }

    fn resume_arguments(&self, run: &Path) -> Vec<String> {
        let path = text(run);
        ["fit", "-o", &path, "--resume", &self.threads()].map(str::to_owned).to_vec()
    }

    /// The arguments of a new fit into the folder `run`. Unless it is empty, `budget` replaces the
    /// sweep's iterations or time.
    pub(crate) fn fit_arguments(&self, cell: &Cell, run: &Path, budget: &[String]) -> Vec<String> {
        let photographs = text(&self.data[cell.data].photographs);
        let mut arguments = vec!["fit".to_owned(), photographs, "-o".to_owned(), text(run)];
        let flags = self.sweep.flags(cell).into_iter().filter(|f| {
            let of_budget = f.starts_with("--iterations=") || f.starts_with("--time=");
            !f.starts_with("--gradient-") && (budget.is_empty() || !of_budget)
        });
        arguments.extend(flags);
        arguments.extend(budget.iter().cloned());
        if self.sweep.setting(cell, "preview_every").is_none() {
            arguments.push(NO_PREVIEWS.to_owned());
        }
        arguments.push(self.threads());
        arguments
    }

    /// The seconds of a fit of a few iterations.
    pub(crate) fn time_short_fit(&self, cell: &Cell, iterations: u64) -> Result<f64, Error> {
        let folder = self.folder(cell);
        std::fs::create_dir_all(&folder)?;
        let budget = [format!("--iterations={iterations}")];
        let arguments = self.fit_arguments(cell, &folder.join("run"), &budget);
        let report = self.command(&folder, "fit", &arguments).map_err(|error| match error {
            StageError::Cell(failure) => {
                Error::content(format!("{}: {}", cell.name, failure.reason))
            }
            StageError::Sweep(error) => error,
        })?;
        report["seconds"].as_f64().ok_or_else(Error::lacks("seconds in the report"))
    }
}

/// Waits until no fit writes to the folder `run`. A fit may outlive a killed sweep, and its work
/// need not be repeated.
pub(crate) fn wait_for_fit(run: &Path) -> Result<(), Error> {
    if let Ok(lock) = std::fs::File::open(run.join("lock")) {
        lock.lock()?;
    }
    Ok(())
}
