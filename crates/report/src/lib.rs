#![doc = include_str!("../README.md")]

mod accuracy;
mod curves;
mod examine;
mod page;
mod solid;
mod surface;
mod tables;
mod verdict;
mod views;

use std::path::Path;

use curves::Metrics;
use dataset::Dataset;
use fit::{Budget, Model, RunFile};

pub use accuracy::sampled_psnr;
pub use examine::{examine, modelled};
pub use surface::{SurfaceShares, surface_shares};
pub use verdict::{Evidence, Fault, Verdict};

/// A run, with all that its page shows.
#[derive(Debug)]
pub struct Run<'a> {
    /// The folder of the run.
    pub folder: &'a Path,
    /// Its `fit.toml`.
    pub file: &'a RunFile,
    /// Its model.
    pub model: &'a Model,
    /// Its data set, relative to its origin, with the cameras and the exposures as fitted.
    pub dataset: &'a Dataset,
    /// Whether it runs, or its verdict.
    pub state: State<'a>,
    /// The models for the background and the masks, one sentence each.
    pub modelled: &'a [String],
    /// The warnings about its photographs, one sentence each.
    pub warnings: &'a [String],
}

/// The state of a run.
#[derive(Clone, Copy, Debug)]
pub enum State<'a> {
    /// A fit that goes on.
    Running,
    /// A fit that was stopped before its end.
    Stopped,
    /// A fit that does not run, with the verdict on it.
    Ended(&'a Verdict),
}

/// The amount of work for a page, and its size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detail {
    /// Grid cells of the mesh along the diameter of the bounding sphere.
    pub cells: usize,
    /// The most faces of the mesh.
    pub faces: usize,
    /// The most views with pictures: held-out ones first, then training ones at equal steps.
    pub views: usize,
    /// The largest width and height of a picture, in pixels.
    pub side: u32,
    /// Samples per pixel of rendered views.
    pub spp: u32,
}

impl Detail {
    /// A page of at most some 8 MB.
    pub const FULL: Detail = Detail { cells: 192, faces: 120_000, views: 48, side: 320, spp: 4 };

    /// A page for a fit that goes on: it takes a few seconds.
    pub const LIVE: Detail = Detail { cells: 96, faces: 40_000, views: 8, side: 192, spp: 1 };
}

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
) -> anyhow::Result<String> {
    let solid = fit::Solid::new(run.model, run.file);
    let views = views::views(run, &solid, detail, &|p| progress(0.6 * p))?;
    let metrics = curves::metrics(&run.folder.join("metrics.jsonl"))?;
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
