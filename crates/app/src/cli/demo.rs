//! `dsdf demo`: the main job on an embedded example.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;

use super::common::{Global, mover};
use super::eval;
use super::fit::{When, fit, start};
use ::fit::{FitOptions, Model, RunFile, scene, write_preview};
use ::scene::SceneFile;
use dataset::synth::{Options, synthesise};
use mesh::{extract, read_mesh, write_mesh};

/// The embedded scene: a rounded solid with a hole through it and a bite out of it.
const SCENE: &str = include_str!("demo_scene.json");

/// Reconstruct an embedded example: no files needed.
#[derive(Args, Debug)]
pub(crate) struct Demo {
    /// The folder to write
    #[arg(short, long, default_value = "dsdf-demo")]
    output: PathBuf,
    /// Wall time of the fit
    #[arg(long, default_value = "160s", value_parser = super::fit::parse_duration)]
    time: Duration,
    /// Views to fit
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(3..=1000))]
    views: u32,
    /// Width and height of the images
    #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u32).range(16..=2048))]
    size: u32,
}

#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    metrics: eval::Report,
    iterations: u64,
    seconds: f64,
    picture: PathBuf,
    mesh: PathBuf,
}

impl Demo {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        let begin = Instant::now();
        let (data, run) = (self.output.join("dataset"), self.output.join("run"));
        // A demo shows the same thing again and again: what an earlier one left is in the way.
        if run.exists() {
            std::fs::remove_dir_all(&run)?;
        }
        eprintln!("rendering {} views of the embedded scene", self.views);
        self.photograph(&data, global)?;
        eprintln!("reconstructing it from those images alone, {} s", self.time.as_secs());
        let options = FitOptions { time: Some(self.time), ..FitOptions::default() };
        let (dataset, file) = start(&data, &options)?;
        let fitted = fit(dataset, file, &run, When::default(), global)?;
        let report = self.evaluate(&data, &run, fitted.iterations(), begin, global)?;
        global.report(&report, || {
            let files =
                format!("picture {}\nmesh    {}", report.picture.display(), report.mesh.display());
            format!(
                "{}\n{} iterations, {:.0} s in all\n{files}",
                report.metrics.table(),
                report.iterations,
                report.seconds
            )
        })
    }

    /// Renders the views; the scene file is left beside them.
    fn photograph(&self, data: &Path, global: &Global) -> anyhow::Result<()> {
        let value: serde_json::Value = serde_json::from_str(SCENE)?;
        let source = data.join("scene.json");
        let scene = SceneFile::from_value(&source, &value)?;
        let options =
            Options { views: self.views as usize, size: [self.size; 2], spp: 16, seed: 0 };
        let bar = global.progress("views");
        synthesise(&scene, &source, data, &options, &mover(&bar))?;
        bar.finish_and_clear();
        io::atomic_write(&source, |out| Ok(out.write_all(SCENE.as_bytes())?))
    }

    fn evaluate(
        &self,
        data: &Path,
        run: &Path,
        iterations: u64,
        begin: Instant,
        global: &Global,
    ) -> anyhow::Result<Report> {
        let (file, model) = (RunFile::load(run)?, Model::load(run)?);
        let dataset = dataset::load(data, &dataset::LoadOptions::default())?;
        let bar = global.progress("evaluate");
        let mut metrics = eval::views(&model, &file, &dataset.test, 4, &mover(&bar))?;
        let mesh = extract(&model.field, &file.sphere(), 192, &mover(&bar));
        let (mesh_path, picture) = (self.output.join("mesh.ply"), self.output.join("demo.png"));
        write_mesh(&mesh_path, &mesh)?;
        metrics.add_mesh(&mesh, &read_mesh(&data.join("truth.ply"))?, file.sphere().radius);
        if let Some(view) = dataset.test.first() {
            let cameras = [view.camera];
            write_preview(&picture, &scene(&model, &file, &cameras), 0, &view.image)?;
        }
        bar.finish_and_clear();
        Ok(Report {
            metrics,
            iterations,
            seconds: begin.elapsed().as_secs_f64(),
            picture,
            mesh: mesh_path,
        })
    }
}
