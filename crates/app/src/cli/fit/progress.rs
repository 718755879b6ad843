//! The progress bar of a fit.

use indicatif::{ProgressBar, ProgressStyle};

use crate::cli::common::Global;
use fit::Metrics;

/// The length of the bar: it moves in steps of 0.01 % of the budget.
const LENGTH: u64 = 10_000;

/// A progress bar on standard error, hidden with `--quiet`.
pub(super) fn bar(global: &Global) -> ProgressBar {
    if global.quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(LENGTH);
    match ProgressStyle::with_template("{wide_bar} {percent:>3} % {eta} left  {msg}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Shows the progress, the loss, the PSNR (held out if known, else of the training pixels) and the
/// speed of an iteration.
pub(super) fn show(bar: &ProgressBar, metrics: &Metrics) {
    bar.set_position((metrics.progress.min(1.0) * LENGTH as f64) as u64);
    let psnr = metrics.psnr.map_or_else(
        || format!("train {:.1} dB", metrics.train_psnr),
        |p| format!("held-out {p:.1} dB"),
    );
    let speed = metrics.rays_per_second / 1e3;
    bar.set_message(format!("loss {:.4}  {psnr}  {speed:.0} k rays/s", metrics.loss));
}
