//! `dsdf inspect`.

use std::borrow::Cow;
use std::path::PathBuf;

use clap::Args;
use glam::DVec3;
use serde::Serialize;

use super::common::{FROM_RUN, Global, as_fitted};
use super::fit::read_for;
use super::query::slope_of;
use ::dataset::Dataset;
use ::inspect::{Report, inspect, overlay};
use ::report::Verdict;
use film::write_image;
use fit::{BackgroundKind, FitOptions, MaskUse, Model, RunFile, RunFolder};
use report::{examine, modelled};

/// Arguments of `dsdf inspect`.
#[derive(Args, Debug)]
pub(crate) struct Inspect {
    /// Data set folder, or folder of a run: its data set with its bounding sphere, and its model
    dataset: PathBuf,
    /// Overlay image to write: every view with the axes and the outline of the bounding sphere
    #[arg(short, long, default_value = "inspect.png")]
    output: PathBuf,
    /// Bounding sphere x,y,z,radius in world units, instead of the estimated one
    #[arg(long, value_parser = ::files::parse_bounds, allow_hyphen_values = true)]
    bounds: Option<[f64; 4]>,
    /// Read images at 1/N of their width and height [default: that of the run, or that of a fit
    /// with default options]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    downscale: Option<u32>,
}

/// The report on a data set, or on a run with its data set.
#[derive(Serialize)]
struct InspectReport {
    #[serde(flatten)]
    dataset: Report,
    /// The model of the background in a fit.
    background_kind: BackgroundKind,
    /// The use of the masks in a fit.
    mask_use: MaskUse,
    /// The slope of the run's network: the 98 % quantile of |∇f| over the bounding sphere, or 1 if
    /// it is at most 1.5. Rays start with it. `None` for a data set.
    slope: Option<f32>,
    /// The verdict on the run's surface and images. `None` for a data set.
    verdict: Option<Verdict>,
}

impl Inspect {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        global.will_write(&self.output, &["png", "exr", "npy"])?;
        let run = match RunFolder::new(&self.dataset).fit_toml().is_file() {
            true => Some(RunFile::load(&self.dataset)?),
            false => None,
        };
        let of_run = run.as_ref().map(RunFile::downscale);
        let options = FitOptions { downscale: self.downscale.or(of_run), ..FitOptions::default() };
        let unread = match &run {
            Some(file) => file.open(None)?,
            None => dataset::open(&self.dataset)?,
        };
        let distortion = unread.distortion();
        let (dataset, _) = read_for(unread, &options, global)?;
        let (file, source, points) = self.understood(run.as_ref(), &dataset, options)?;
        let source = if self.bounds.is_some() { "as asked" } else { &source };
        // The model first: a run without one has no picture.
        let model = match &run {
            Some(file) => Some(Model::load(&self.dataset, file)?),
            None => None,
        };
        let sphere = file.world_sphere();
        write_image(&self.output, &overlay(&dataset, &sphere, &points))?;
        let seen = file.composited(Cow::Borrowed(&dataset));
        let mut report = inspect(&seen, &sphere, &file.background(), source);
        report.distortion = Some(distortion);
        let modelled = modelled(&dataset, &file);
        let (slope, verdict) = match (&run, model) {
            (Some(file), Some(model)) => {
                let mut dataset = file.prepare(dataset);
                as_fitted(&self.dataset, &model, file, &mut dataset, false, global)?;
                let verdict = examine(&model, file, &dataset)?;
                (Some(slope_of(&model.field)), Some(verdict))
            }
            _ => (None, None),
        };
        let RunFile { background_kind, masks, .. } = file;
        let report =
            InspectReport { dataset: report, background_kind, mask_use: masks, slope, verdict };
        global.report(&report, || {
            let slope = slope.map_or(String::new(), |s| format!("\nslope        {s}"));
            let verdict = report.verdict.as_ref().map_or(String::new(), |v| format!("\n{v}"));
            let [model, masks] = modelled.each_ref().map(|line| match line.split_once(": ") {
                Some((_, value)) => value,
                None => line,
            });
            let of_fit = format!("\nmodel        {model}\nmasks        {masks}");
            let picture = self.output.display();
            let warnings = report.dataset.warning_rows();
            let dataset = &report.dataset;
            format!("{dataset}{of_fit}{slope}\npicture      {picture}{warnings}{verdict}")
        })
    }

    /// A run with the bounding sphere of the option, or what a fit would find: the evidence for the
    /// sphere, and points on surfaces.
    fn understood(
        &self,
        run: Option<&RunFile>,
        dataset: &Dataset,
        options: FitOptions,
    ) -> anyhow::Result<(RunFile, String, Vec<DVec3>)> {
        let mut points = dataset.points.clone();
        if let Some(file) = run {
            let bounds = self.bounds.unwrap_or(file.bounds);
            return Ok((RunFile { bounds, ..file.clone() }, FROM_RUN.to_owned(), points));
        }
        let options = FitOptions { bounds: self.bounds, ..options };
        let (file, found) = RunFile::of_dataset(self.dataset.clone(), dataset, &options)?;
        points.extend(found.points);
        Ok((file, found.source.to_string(), points))
    }
}
