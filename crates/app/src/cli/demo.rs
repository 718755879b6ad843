//! `dsdf demo`: synthesis, fit and evaluation of an embedded example.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::Args;
use serde::Serialize;

use super::common::Global;
use super::eval::{EvalReport, SAMPLES, compare_views};
use super::fit::{Segment, fit, lock, new_run, refuse_occupied};
use super::mesh::mesh_of_run;
use super::report::{About, write_whole};
use ::fit::{FitOptions, Model, RefineCameras, RunFile, Solid};
use ::mesh::{read_mesh, write_mesh};
use ::report::State;
use ::scene::SceneFile;
use dataset::{Dataset, LoadOptions};
use fit::write_preview;
use scene::synth::{Options, synthesise};

/// The embedded scene: a rounded solid with a hole through it, and a ball cut out of its side.
const SCENE: &str = include_str!("demo_scene.json");

/// Samples per pixel of the training images.
const TRAINING_SPP: u32 = 16;

/// Grid cells of the mesh along the diameter of the bounding sphere.
const MESH_CELLS: usize = 192;

/// Arguments of `dsdf demo`.
#[derive(Args, Debug)]
pub(crate) struct Demo {
    /// Folder to write; its subfolder `run` is replaced
    #[arg(short, long, default_value = "dsdf-demo")]
    output: PathBuf,
    /// Wall time of the fit, for example 90 (seconds) or 10m
    #[arg(long, default_value = "160s", value_parser = ::files::parse_duration)]
    time: Duration,
    /// Number of training views
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(3..=1000))]
    views: u32,
    /// Width and height of the images in pixels
    #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u32).range(16..=2048))]
    size: u32,
}

/// The result of `dsdf demo`.
#[derive(Serialize)]
struct DemoReport {
    /// The errors of the fit, as in `dsdf eval`.
    #[serde(flatten)]
    metrics: EvalReport,
    /// Iterations of the fit.
    iterations: u64,
    /// Wall time of the whole command, in seconds.
    seconds: f64,
    /// The preview picture.
    picture: PathBuf,
    /// The mesh file.
    mesh: PathBuf,
    /// The page of the run, as of `dsdf report`.
    page: PathBuf,
}

impl DemoReport {
    fn text(&self) -> String {
        format!(
            "{}\n{} iterations, {:.0} s in all\npicture {}\nmesh    {}\npage    {}",
            self.metrics.table(),
            self.iterations,
            self.seconds,
            self.picture.display(),
            self.mesh.display(),
            self.page.display()
        )
    }
}

impl Demo {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        let start = Instant::now();
        let (data, run) = (self.output.join("dataset"), self.output.join("run"));
        let folders =
            ["train", "test", "masks/train", "masks/test"].map(|f| format!("dataset/{f}"));
        let folders: Vec<&str> = folders.iter().map(String::as_str).collect();
        let of_run = ["dataset", "run", "run/checkpoint", "run/preview"];
        global.will_write_in(&self.output, &[&folders[..], &of_run].concat())?;
        remove_run(&run)?;
        global.say(&format!("rendering {} views of the embedded scene", self.views));
        self.synthesise(&data, global)?;
        let seconds = self.time.as_secs();
        global.say(&format!("reconstructing it from those images alone, {seconds} s"));
        // The cameras of the scene are exact.
        let refine_cameras = RefineCameras::None;
        let options = FitOptions { time: Some(self.time), refine_cameras, ..FitOptions::default() };
        let (dataset, file, _) = new_run(&data, &options, global)?;
        let (fitted, session) = fit(dataset, file, &run, Segment::default(), global)?;
        let [mesh, picture, page] =
            ["mesh.ply", "demo.png", "report.html"].map(|name| self.output.join(name));
        let metrics = evaluate(&data, &run, &mesh, &picture, global)?;
        let fitting = &session.fit;
        let dataset = &fitting.photographs.dataset;
        let of_fit = (&fitting.model, &fitting.file, dataset);
        let about = About::of(dataset, &fitting.file);
        let state = fitted.verdict.as_ref().map_or(State::Stopped, State::Ended);
        write_whole(&about.run(&run, of_fit, state), &page, global)?;
        let iterations = fitted.iterations;
        let seconds = start.elapsed().as_secs_f64();
        let report = DemoReport { metrics, iterations, seconds, picture, mesh, page };
        global.report(&report, || report.text())
    }

    /// Renders the data set into `data` and writes the scene file next to it.
    fn synthesise(&self, data: &Path, global: &Global) -> anyhow::Result<()> {
        let value: serde_json::Value = serde_json::from_str(SCENE)?;
        let source = data.join("scene.json");
        let scene = SceneFile::from_value(&source, &value)?;
        let (views, size) = (self.views as usize, [self.size; 2]);
        let options = Options { views, size, spp: TRAINING_SPP, seed: 0 };
        let bar = global.progress("views");
        synthesise(&scene, &source, data, &options, &bar.mover())?;
        bar.finish_and_clear();
        Ok(files::atomic_write(&source, |out| out.write_all(SCENE.as_bytes()))?)
    }
}

/// Removes the run of an earlier demo: a new fit refuses a folder with a checkpoint. A folder that
/// is no run stays.
fn remove_run(run: &Path) -> anyhow::Result<()> {
    if RunFile::load(run).is_err() {
        return Ok(refuse_occupied(run)?);
    }
    let lock = lock(run)?;
    std::fs::remove_dir_all(run).with_context(|| format!("cannot remove {}", run.display()))?;
    drop(lock);
    Ok(())
}

/// Compares a run with its data set: held-out views, the true surface, and a preview picture.
/// Writes the mesh of the run to `mesh_path` and the picture to `picture`.
fn evaluate(
    data: &Path,
    run: &Path,
    mesh_path: &Path,
    picture: &Path,
    global: &Global,
) -> anyhow::Result<EvalReport> {
    let file = RunFile::load(run)?;
    let model = Model::load(run, &file)?;
    let options = LoadOptions { downscale: file.downscale() };
    let dataset = file.prepare(dataset::load(data, &options)?);
    let bar = global.progress("evaluate");
    let (views, spp) = (&dataset.test, SAMPLES);
    let mut report = compare_views(&model, &file, views, spp, None, &bar.mover())?;
    bar.finish_and_clear();
    let bar = global.progress("mesh");
    let mesh = mesh_of_run(&model, &file, MESH_CELLS, &bar.mover());
    bar.finish_and_clear();
    write_mesh(mesh_path, &mesh)?;
    report.add_mesh(&mesh, &read_mesh(&data.join("truth.ply"))?, file.sphere().radius);
    preview(&dataset, &model, &file, picture)?;
    Ok(report)
}

/// Writes the picture of the first held-out view: target, render, normals, error.
fn preview(dataset: &Dataset, model: &Model, file: &RunFile, picture: &Path) -> anyhow::Result<()> {
    if let Some(view) = dataset.test.first() {
        let cameras = [view.camera];
        write_preview(picture, &Solid::new(model, file).scene(&cameras), 0, &view.image)?;
    }
    Ok(())
}
