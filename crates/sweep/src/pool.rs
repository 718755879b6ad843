//! Cells, a few at a time, with progress.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Instant;

use indicatif::{ProgressBar, ProgressStyle};

use super::cell::Bench;
use super::results::{Row, finished, metric};
use super::sweep::Cell;

/// Steps of the bar a cell.
const STEPS: u64 = 1000;

/// Runs all cells that are not finished.
pub(super) fn run(context: &Bench<'_>, cells: &[Cell], jobs: usize) -> anyhow::Result<()> {
    let left: Vec<&Cell> =
        cells.iter().filter(|cell| finished(&context.folder(cell)).is_none()).collect();
    if left.is_empty() {
        return Ok(());
    }
    let bar = ProgressBar::new(cells.len() as u64 * STEPS);
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {percent:>3} % {eta} left  {msg}") {
        bar.set_style(style);
    }
    let done = AtomicUsize::new(cells.len() - left.len());
    bar.set_position(done.load(Ordering::Relaxed) as u64 * STEPS);
    bar.reset_eta();
    let (next, failure) = (AtomicUsize::new(0), Mutex::new(None));
    let fractions: Vec<AtomicU64> = (0..jobs).map(|_| AtomicU64::new(0)).collect();
    std::thread::scope(|scope| {
        for job in 0..jobs.min(left.len()) {
            let (next, failure, done, fractions, left, bar) =
                (&next, &failure, &done, &fractions, &left, &bar);
            scope.spawn(move || {
                let show = |fraction: f64| {
                    // What is measured after a fit takes a while too.
                    fractions[job].store((0.9 * fraction * STEPS as f64) as u64, Ordering::Relaxed);
                    let running: u64 = fractions.iter().map(|f| f.load(Ordering::Relaxed)).sum();
                    bar.set_position(done.load(Ordering::Relaxed) as u64 * STEPS + running);
                };
                while let Some(cell) = left.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let start = Instant::now();
                    match context.run(cell, &show) {
                        Ok(row) => {
                            fractions[job].store(0, Ordering::Relaxed);
                            let count = done.fetch_add(1, Ordering::Relaxed) + 1;
                            show(0.0);
                            let line =
                                line(&row, cell, count, cells.len(), start.elapsed().as_secs_f64());
                            bar.suspend(|| eprintln!("{line}"));
                        }
                        Err(error) => {
                            next.store(left.len(), Ordering::Relaxed);
                            failure.lock().unwrap_or_else(|e| e.into_inner()).get_or_insert(error);
                        }
                    }
                }
            });
        }
    });
    bar.finish_and_clear();
    failure.into_inner().unwrap_or_else(|e| e.into_inner()).map_or(Ok(()), Err)
}

fn line(row: &Row, cell: &Cell, done: usize, all: usize, seconds: f64) -> String {
    let number = |name: &str| {
        let known =
            metric(name).and_then(|m| Some((row.numbers.get(name)? * m.shown.0, m.shown.1)));
        known.map_or("-".to_owned(), |(v, unit)| format!("{v:.2}{unit}"))
    };
    let end = if row.status == "done" {
        format!(
            "Chamfer {}, {}{}",
            number("chamfer"),
            number("psnr"),
            if row.converged { "" } else { ", not converged" }
        )
    } else {
        format!("{}: {}", row.status, row.reason)
    };
    format!("{done}/{all} {}: {seconds:.0} s, {end}", cell.name)
}
