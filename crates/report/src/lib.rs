#![doc = include_str!("../README.md")]

mod accuracy;
mod curves;
mod detail;
mod error;
mod escape;
mod examine;
mod page;
mod run;
mod solid;
mod surface;
mod tables;
mod verdict;
mod views;

use curves::Metrics;
use fit::{Budget, RunFolder};

pub use accuracy::sampled_psnr;
pub use detail::Detail;
pub use error::Error;
pub use examine::{examine, modelled};
pub use run::{Run, State};
pub use surface::{SurfaceShares, surface_shares};
pub use verdict::{Evidence, Fault, Verdict};

/// The page of a run: one HTML file that needs no other.
///
/// `progress` gets the fraction done, on any thread.
///
/// # Errors
/// If the field gives a NaN or an infinity, or a file of the run cannot be read.
pub fn page(
    run: &Run<'_>,
    detail: Detail,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<String, Error> {
    let solid = fit::Solid::new(run.model, run.file);
    let views = views::views(run, &solid, detail, &|p| progress(0.6 * p))?;
    let metrics = curves::metrics(&RunFolder::new(run.folder).metrics())?;
    let Metrics { curves, iterations, seconds, warning } = metrics;
    let scene = page::Scene {
        frame: solid::Frame::of(run),
        mesh: solid::mesh(run, &solid, detail, &|p| progress(0.6 + 0.4 * p))?,
        views,
        curves,
    };
    let warnings: Vec<&str> =
        run.warnings.iter().map(String::as_str).chain(warning.as_deref()).collect();
    page::html(run, &scene, &warnings, &spent(run, iterations, seconds))
}

/// The last line of the metrics is older than the end of the fit by the time of its last files. So
/// this share of the budget and a second may lack.
const UNRECORDED: f64 = 0.01;

/// The budget that a run has spent. A run that was stopped has spent a part of it.
fn spent(run: &Run<'_>, iterations: u64, seconds: f64) -> String {
    let budget = run.file.options.budget();
    match budget {
        Budget::Time(time) if seconds + 1.0 < (1.0 - UNRECORDED) * time.as_secs_f64() => {
            let all = time.as_secs_f64();
            format!("{iterations} iterations, {seconds:.0} s of {all:.0} s: not finished")
        }
        Budget::Iterations(all) if iterations < all => {
            format!("{iterations} of {all} iterations, {seconds:.0} s: not finished")
        }
        _ => format!("{iterations} iterations, {seconds:.0} s"),
    }
}
