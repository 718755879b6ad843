//! The progress of a fit.

use crate::cli::common::Global;
use crate::messages::Progress;
use fit::{Fit, Metrics};

/// The progress of a fit on standard error: a bar on a terminal, else a line about every ten
/// seconds; nothing with `--quiet`.
pub(super) fn start(global: &Global) -> Progress {
    global.progress_with_text("fit")
}

/// Finds the depths that guide the fit, with their progress.
pub(super) fn find_depths(fitting: &mut Fit, stop: &dyn Fn() -> bool, global: &Global) {
    if !fitting.lacks_depths() {
        return;
    }
    let bar = global.progress_with_text("depths");
    // The search begins anew after an adjustment of the cameras.
    let (mut search, mut last) = (1, 0);
    fitting.find_depths(stop, &mut |done, all| {
        search += usize::from(done < last);
        last = done;
        bar.show(done as f64 / all as f64, &|| {
            format!("{done} of {all} photographs, search {search}")
        });
    });
    bar.finish_and_clear();
    if let Some(known) = fitting.photographs.known_depths() {
        let unused = if known > 0.0 { "" } else { "; too few to use, or too short a fit" };
        let share = 100.0 * known;
        global.say(&format!("depths: known at {share:.0} % of the pixels{unused} (see --stereo)"));
    }
}

/// Shows the progress, the number of iterations, the loss, the PSNR of the last preview of a
/// held-out view (of the training pixels before the first) and the speed of an iteration.
///
/// A preview has one sample per pixel, so its PSNR is lower than that of `dsdf eval`.
pub(super) fn show(progress: &Progress, metrics: &Metrics) {
    progress.show(metrics.progress, &|| {
        let psnr = metrics.psnr.map_or_else(
            || format!("train {:.1} dB", metrics.step.train_psnr),
            |p| format!("preview {p:.1} dB"),
        );
        let speed = metrics.rays_per_second / 1e3;
        let (iteration, loss) = (metrics.step.iteration, metrics.step.loss);
        format!("{iteration} iterations  loss {loss:.4}  {psnr}  {speed:.0} k rays/s")
    });
}
