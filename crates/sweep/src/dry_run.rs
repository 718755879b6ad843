//! `--dry-run`: the cells of a sweep and an estimate of its time.

use std::path::Path;

use crate::error::Error;
use crate::report::Cell;
use crate::report::results::finished;

use crate::console::print;
use crate::folder::SweepFolder;
use crate::runner::CellRunner;

/// Iterations of a fit that is timed for the estimate.
const TIMED_ITERATIONS: u64 = 30;

/// Largest number of cells that are timed, spread over the sweep.
const TIMED_CELLS: usize = 4;

/// Iterations of a fit with a preset: those of the default preset, since this crate does not know
/// the presets.
const PRESET_ITERATIONS: u64 = 6000;

/// Seconds of evaluation and gradient test after a fit, roughly.
const SECONDS_AFTER_FIT: f64 = 10.0;

/// Prints the cells with their status, and an estimate of the time for the others.
pub(crate) fn show(
    folder: &SweepFolder,
    binary: &Path,
    cells: &[Cell],
    jobs: usize,
) -> Result<(), Error> {
    let (mut known, mut left) = (Vec::new(), Vec::new());
    for (number, cell) in cells.iter().enumerate() {
        let result = finished(&folder.cell(cell));
        let status = result.as_ref().map_or("", |result| result.status.as_str());
        print(&format!("{number:>5} {} {status}\n", cell.name));
        match result {
            Some(result) => known.extend(result.numbers.get("seconds").copied()),
            None => left.push(cell),
        }
    }
    let seconds = if left.is_empty() {
        0.0
    } else if known.is_empty() {
        estimate_fit(folder, binary, &left)?
    } else {
        known.iter().sum::<f64>() / known.len() as f64
    };
    let minutes = left.len() as f64 * (seconds + SECONDS_AFTER_FIT) / jobs as f64 / 60.0;
    print(&format!(
        "{} cells, {} to run: about {minutes:.0} minutes with {jobs} at a time \
         ({seconds:.0} s a fit)\n",
        cells.len(),
        left.len()
    ));
    Ok(())
}

/// The seconds of a fit: the sweep's time, or the mean of a few short fits, scaled.
fn estimate_fit(folder: &SweepFolder, binary: &Path, cells: &[&Cell]) -> Result<f64, Error> {
    if let Some(time) = &folder.sweep.time {
        return Ok(humantime::parse_duration(time).map_err(Error::content)?.as_secs_f64());
    }
    let scratch = tempfile::tempdir()?;
    let trial = SweepFolder {
        sweep: folder.sweep.clone(),
        base: folder.base.clone(),
        output: scratch.path().to_owned(),
    };
    let data = trial.data_folders(binary)?;
    let runner =
        CellRunner { sweep: &trial.sweep, binary, data: &data, cells: trial.cells(), threads: 1 };
    let step = cells.len().div_ceil(TIMED_CELLS).max(1);
    let timed: Vec<&&Cell> = cells.iter().step_by(step).collect();
    let mut seconds = 0.0;
    for cell in &timed {
        seconds += runner.time_short_fit(cell, TIMED_ITERATIONS)?;
    }
    let iterations = folder.sweep.iterations.unwrap_or(PRESET_ITERATIONS);
    Ok(seconds / timed.len() as f64 / TIMED_ITERATIONS as f64 * iterations as f64)
}
