//! `dsdf render`.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use field::{Counted, Evaluations};
use serde::Serialize;

use super::common::{Global, PrecisionArg, check_extension, color, mover};
use dataset::LoadOptions;
use fit::{Model, RunFile, around, turntable, upwards};
use io::{InputError, write_image};
use render::{Precision, Scene, render};
use scene::SceneFile;

/// Render a scene to an image, or the object of a run from all around: as it looks, and its
/// normals.
#[derive(Args, Debug)]
pub(crate) struct Render {
    /// The scene file, or the folder of a run
    scene: PathBuf,
    /// The image to write: .png (sRGB), .exr or .npy (linear)
    #[arg(short, long)]
    output: PathBuf,
    /// Samples a pixel
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..))]
    spp: u32,
    /// Seed of the samples
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Precision of the computation
    #[arg(long, value_enum, default_value = "f32")]
    precision: PrecisionArg,
    /// Of a run: views around the object
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=360))]
    views: u32,
    /// Of a run: width and height of each view
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(8..=4096))]
    size: u32,
}

#[derive(Serialize)]
struct Report {
    width: u32,
    height: u32,
    spp: u32,
    seconds: f64,
    evaluations: Evaluations,
}

#[derive(Serialize)]
struct TurntableReport {
    width: u32,
    height: u32,
    views: usize,
    /// The direction that was taken for upwards, world space.
    up: [f64; 3],
}

impl Render {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        check_extension(&self.output, &["png", "exr", "npy"])?;
        if self.scene.is_dir() {
            return self.turntable(global);
        }
        match self.precision {
            PrecisionArg::F32 => self.run_in::<f32>(global),
            PrecisionArg::F64 => self.run_in::<f64>(global),
        }
    }

    fn turntable(&self, global: &Global) -> anyhow::Result<()> {
        let (file, model) = (RunFile::load(&self.scene)?, Model::load(&self.scene)?);
        let dataset = dataset::load(&file.dataset, &LoadOptions::default())?;
        let (bounds, taken) =
            (file.sphere(), dataset.train.iter().map(|v| v.camera).collect::<Vec<_>>());
        let up = upwards(&taken, bounds.center);
        let cameras = around(&bounds, &taken, up, self.views as usize, self.size);
        let bar = global.progress("turntable");
        let sheet = turntable(&model, &file, &cameras, self.spp, &mover(&bar))?;
        bar.finish_and_clear();
        write_image(&self.output, &sheet)?;
        let (width, height) = (sheet.width, sheet.height);
        let report = TurntableReport { width, height, views: cameras.len(), up: up.to_array() };
        global.report(&report, || format!("{} views, {width} x {height} pixels", cameras.len()))
    }

    fn run_in<R: Precision>(&self, global: &Global) -> anyhow::Result<()> {
        let file = SceneFile::load(&self.scene)?;
        let field = Counted::new(file.sdf.build::<R>()?);
        let shader = file.shader::<R>(&field)?;
        let cameras = [file.camera];
        let background = color::<R>(file.background);
        let scene = Scene::new(&field, &*shader, &cameras, &file.bounds, background);
        let bar = global.progress("render");
        let start = Instant::now();
        let image = render(&scene, 0, self.spp, self.seed, &mover(&bar))
            .map_err(|e| InputError::new(&self.scene, "/sdf", e, "a finite field"))?;
        let seconds = start.elapsed().as_secs_f64();
        bar.finish_and_clear();
        write_image(&self.output, &image.film)?;
        let (width, height) = (image.film.width, image.film.height);
        let evaluations = field.evaluations();
        let report = Report { width, height, spp: self.spp, seconds, evaluations };
        global.report(&report, || {
            format!("{width} x {height} pixels, {} samples each, {seconds:.3} s", self.spp)
        })
    }
}
