//! Runs several cells at a time, with a progress bar.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Instant;

use crate::error::Error;
use crate::report::Cell;
use crate::report::metrics::metric;
use crate::report::results::{CellResult, finished};
use indicatif::{ProgressBar, ProgressStyle};

use crate::runner::CellRunner;

/// Steps of the progress bar for one cell.
const STEPS: u64 = 1000;

/// The part of a cell's progress that the fit takes; evaluation and gradient test take the rest.
const FIT: f64 = 0.9;

/// The state that the threads of a pool share.
struct Pool<'a> {
    runner: &'a CellRunner<'a>,
    /// The cells to run.
    left: Vec<&'a Cell>,
    /// Number of cells, with those that were finished before.
    all: usize,
    /// Index in `left` of the next cell to start.
    next: AtomicUsize,
    /// Number of finished cells.
    done: AtomicUsize,
    /// Steps of each thread's cell.
    progress: Vec<AtomicU64>,
    /// The first error of a cell; it keeps further cells from starting.
    failure: Mutex<Option<Error>>,
    bar: ProgressBar,
}

/// Runs all cells that are not finished, `jobs` at a time.
///
/// # Errors
/// The first error of a cell, after the cells that run at that time.
pub(crate) fn run(runner: &CellRunner<'_>, cells: &[Cell], jobs: usize) -> Result<(), Error> {
    let unfinished = |cell: &&Cell| finished(&runner.folder(cell)).is_none();
    let left: Vec<&Cell> = cells.iter().filter(unfinished).collect();
    if left.is_empty() {
        return Ok(());
    }
    let pool = Pool {
        runner,
        all: cells.len(),
        next: AtomicUsize::new(0),
        done: AtomicUsize::new(cells.len() - left.len()),
        progress: (0..jobs).map(|_| AtomicU64::new(0)).collect(),
        failure: Mutex::new(None),
        bar: ProgressBar::new(cells.len() as u64 * STEPS),
        left,
    };
    pool.start_bar();
    std::thread::scope(|scope| {
        for job in 0..jobs.min(pool.left.len()) {
            let pool = &pool;
            scope.spawn(move || pool.work(job));
        }
    });
    pool.bar.finish_and_clear();
    pool.failure.into_inner().unwrap_or_else(|e| e.into_inner()).map_or(Ok(()), Err)
}

impl Pool<'_> {
    fn start_bar(&self) {
        let template = "{wide_bar} {percent:>3} % {eta} left  {msg}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            self.bar.set_style(style);
        }
        self.show();
        // Cells of an earlier call say nothing about the speed of this one.
        self.bar.reset_eta();
    }

    /// Runs cells until none is left or one has an error.
    fn work(&self, job: usize) {
        while let Some(cell) = self.left.get(self.next.fetch_add(1, Ordering::Relaxed)) {
            let start = Instant::now();
            match self.runner.run(cell, &|fraction| self.set_progress(job, fraction)) {
                Ok(result) => self.finish(job, &result, cell, start.elapsed().as_secs_f64()),
                Err(error) => {
                    self.next.store(self.left.len(), Ordering::Relaxed);
                    self.failure.lock().unwrap_or_else(|e| e.into_inner()).get_or_insert(error);
                }
            }
        }
    }

    /// Sets the finished fraction of the fit of one thread's cell.
    fn set_progress(&self, job: usize, fraction: f64) {
        let steps = (FIT * fraction * STEPS as f64) as u64;
        self.progress[job].store(steps, Ordering::Relaxed);
        self.show();
    }

    fn finish(&self, job: usize, result: &CellResult, cell: &Cell, seconds: f64) {
        self.progress[job].store(0, Ordering::Relaxed);
        let count = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        self.show();
        let line = summary(result, cell, count, self.all, seconds);
        self.bar.suspend(|| eprintln!("{line}"));
    }

    /// Moves the bar to the sum of finished and running cells.
    fn show(&self) {
        let running: u64 = self.progress.iter().map(|p| p.load(Ordering::Relaxed)).sum();
        self.bar.set_position(self.done.load(Ordering::Relaxed) as u64 * STEPS + running);
    }
}

/// The line of a finished cell: count, name, seconds, and numbers or the reason of its failure.
fn summary(result: &CellResult, cell: &Cell, done: usize, all: usize, seconds: f64) -> String {
    let number = |name: &str| {
        let known =
            metric(name).and_then(|m| Some((result.numbers.get(name)? * m.shown.0, m.shown.1)));
        known.map_or("-".to_owned(), |(v, unit)| format!("{v:.2}{unit}"))
    };
    let end = if result.status == "done" {
        let remark = if result.converged { "" } else { ", not converged" };
        format!("Chamfer {}, {}{remark}", number("chamfer"), number("psnr"))
    } else {
        format!("{}: {}", result.status, result.reason)
    };
    format!("{done}/{all} {}: {seconds:.0} s, {end}", cell.name)
}
