//! `dsdf cameras`: the cameras of a run, as a data set for other programs.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::common::{Global, align_held_out, with_fitted_cameras};
use dataset::{LoadOptions, check_empty, write};
use fit::{Model, RunFile};

/// Arguments of `dsdf cameras`.
#[derive(Args, Debug)]
pub(crate) struct Cameras {
    /// Run folder
    run: PathBuf,
    /// Data set folder to write, new or empty: transforms.json, sparse/0 and images
    #[arg(short, long)]
    output: PathBuf,
    /// Data set folder [default: the data set of the run]
    #[arg(long)]
    dataset: Option<PathBuf>,
    /// Write the photographs at 1/N of their width and height [default: as the fit read them]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    downscale: Option<u32>,
}

/// The result of `dsdf cameras`.
#[derive(Serialize)]
struct Written {
    /// The data set.
    dataset: PathBuf,
    /// Views that were fitted, and held-out ones.
    views: [usize; 2],
    /// Whether the run refined its cameras.
    refined: bool,
    /// The largest error of the conversion of lenses, in pixels.
    lens_error: f64,
}

/// The error of a lens, in pixels, from which on a sentence tells it.
const LENS_ERROR: f64 = 0.1;

impl Cameras {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        check_empty(&self.output)?;
        global.will_write_in(&self.output, &["images", "sparse/0"])?;
        let file = RunFile::load(&self.run)?;
        let downscale = self.downscale.unwrap_or(file.downscale());
        let bar = global.progress("photographs");
        let unread = file.open(self.dataset.as_deref())?;
        let dataset = unread.read(&LoadOptions { downscale }, &mut bar.mover())?;
        bar.finish_and_clear();
        let mut dataset = dataset.about(file.origin());
        // Another data set without the views of the run is refused.
        let refined = with_fitted_cameras(&self.run, &file, &mut dataset, false)?;
        if refined && !dataset.test.is_empty() {
            align_held_out(&Model::load(&self.run, &file)?, &file, &mut dataset, global)?;
        }
        let dataset = dataset.about(-file.origin());
        let bar = global.progress("data set");
        let lens_error = write(&self.output, &dataset, &mut bar.mover())?;
        bar.finish_and_clear();
        if !refined {
            global.say("cameras: those of the data set, which the run did not change");
        }
        if lens_error > LENS_ERROR {
            global.say(&format!(
                "WARNING the lens of the other programs is up to {lens_error:.2} pixels off that of the run"
            ));
        }
        let views = [dataset.train.len(), dataset.test.len()];
        let written = Written { dataset: self.output.clone(), views, refined, lens_error };
        global.report(&written, || {
            let [train, test] = views;
            let which = if written.refined { "refined cameras" } else { "cameras as given" };
            format!("{}: {which} of {train} views and {test} held out", self.output.display())
        })
    }
}
