//! `dsdf cameras`: the cameras of a run, as a data set for other programs.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::common::Global;
use dataset::{LoadOptions, check_empty, write};
use fit::{Model, RunCameras, RunFile, align};

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
        let refined = RunCameras::load(&self.run)?;
        let downscale = self.downscale.unwrap_or(file.downscale());
        let bar = global.progress("photographs");
        let unread = file.open(self.dataset.as_deref())?;
        let dataset =
            unread.read(&LoadOptions { downscale }, &mut |done| bar.mover()(0.5 * done))?;
        let mut dataset = dataset.about(file.origin());
        if let Some(cameras) = &refined {
            cameras.apply(&mut dataset, file.origin(), &self.run)?;
            if !dataset.test.is_empty() {
                // The given ones are in the world as it was before.
                let model = Model::load(&self.run, &file)?;
                let found = align(&model, &file, &dataset.test, &|_| {})?;
                dataset.test.iter_mut().zip(found).for_each(|(view, own)| view.camera = own);
            }
        }
        let dataset = dataset.about(-file.origin());
        let move_on = &mut |done: f64| bar.mover()(0.5 + 0.5 * done);
        let lens_error = write(&self.output, &dataset, move_on)?;
        bar.finish_and_clear();
        if refined.is_none() {
            global.say("cameras: those of the data set, which the run did not change");
        }
        if lens_error > LENS_ERROR {
            global.say(&format!(
                "WARNING the lens of the other programs is up to {lens_error:.2} pixels off that of the run"
            ));
        }
        let views = [dataset.train.len(), dataset.test.len()];
        let written =
            Written { dataset: self.output.clone(), views, refined: refined.is_some(), lens_error };
        global.report(&written, || {
            let [train, test] = views;
            let which = if written.refined { "refined cameras" } else { "cameras as given" };
            format!("{}: {which} of {train} views and {test} held out", self.output.display())
        })
    }
}
