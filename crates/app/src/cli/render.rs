//! `dsdf render`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use field::{Counted, Evaluations, SLOPE_POINTS};
use serde::Serialize;

use super::common::{ARGUMENTS, Global, PrecisionArg, RENDER_BYTES, check_film, option_error};
use export::bake::SeenOnly;
use files::InputError;
use film::write_image;
use fit::{Model, RunFile, Solid};
use render::{Scene, render};
use render::{around, turntable, upwards};
use scene::{SceneFile, ScenePrecision};

/// Arguments of `dsdf render`.
#[derive(Args, Debug)]
pub(crate) struct Render {
    /// Scene file (JSON), or folder of a run
    scene: PathBuf,
    /// Image to write: .png (sRGB), .exr or .npy (linear)
    #[arg(short, long)]
    output: PathBuf,
    /// Samples per pixel
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=65536))]
    spp: u32,
    /// Seed of the samples, for scene files [default: 0]
    #[arg(long, help_heading = "Scene files")]
    seed: Option<u64>,
    /// Floating-point precision, for scene files [default: f32]
    #[arg(long, help_heading = "Scene files", value_enum)]
    precision: Option<PrecisionArg>,
    /// ρ: length of a tracing step as a fraction of f, for scene files; below 1 for fields steeper
    /// than a distance [default: 1]
    #[arg(long, help_heading = "Scene files")]
    relaxation: Option<f64>,
    /// Data set folder whose cameras tell the upward direction, for runs [default: the data set of
    /// the run]
    #[arg(long)]
    dataset: Option<PathBuf>,
    /// Number of views around the object, for runs [default: 8]
    #[arg(long, help_heading = "Runs", value_parser = clap::value_parser!(u32).range(1..=360))]
    views: Option<u32>,
    /// Width and height of each view in pixels, for runs [default: 256]
    #[arg(long, help_heading = "Runs", value_parser = clap::value_parser!(u32).range(8..=4096))]
    size: Option<u32>,
}

/// The result of rendering a scene file.
#[derive(Serialize)]
struct RenderReport {
    /// Width of the image, pixels.
    width: u32,
    /// Height of the image, pixels.
    height: u32,
    /// Samples per pixel.
    spp: u32,
    /// Wall time of rendering without file access, in seconds.
    seconds: f64,
    /// Evaluations of the field.
    evaluations: Evaluations,
}

/// The result of rendering a run.
#[derive(Serialize)]
struct TurntableReport {
    /// Width of the image of all views, pixels.
    width: u32,
    /// Height of the image of all views, pixels.
    height: u32,
    /// Number of views.
    views: usize,
    /// The upward direction: a unit vector in world space.
    up: [f64; 3],
}

impl Render {
    pub(crate) fn run(&self, global: &Global) -> anyhow::Result<()> {
        global.will_write(&self.output, &["png", "exr", "npy"])?;
        let is_run = self.scene.is_dir();
        self.refuse_options_of_the_other(is_run)?;
        if is_run {
            return self.render_run(global);
        }
        match self.precision {
            None | Some(PrecisionArg::F32) => self.render_scene::<f32>(global),
            Some(PrecisionArg::F64) => self.render_scene::<f64>(global),
        }
    }

    /// Refuses the options of scene files for a run, and those of runs for a scene file.
    fn refuse_options_of_the_other(&self, is_run: bool) -> Result<(), InputError> {
        let of_scenes = [
            ("seed", self.seed.is_some()),
            ("precision", self.precision.is_some()),
            ("relaxation", self.relaxation.is_some()),
        ];
        let of_runs = [
            ("dataset", self.dataset.is_some()),
            ("views", self.views.is_some()),
            ("size", self.size.is_some()),
        ];
        let (others, found, expected) = match is_run {
            true => (of_scenes, "a run folder to render", "a scene file: the option is for these"),
            false => (of_runs, "a scene file to render", "a run folder: the option is for these"),
        };
        match others.into_iter().find(|(_, is_given)| *is_given) {
            Some((name, _)) => Err(option_error(name, found.to_owned(), expected)),
            None => Ok(()),
        }
    }

    /// Renders a run: views from around the object in the upper row, their normals below.
    fn render_run(&self, global: &Global) -> anyhow::Result<()> {
        // The sheet has a view and its normals for each image, beside the images themselves.
        let (views, size) = (self.views.unwrap_or(8), self.size.unwrap_or(256));
        let (count, bytes) = (u64::from(views), 2 * RENDER_BYTES);
        check_film(Path::new(ARGUMENTS), "--size", [size; 2], count, bytes)?;
        let file = RunFile::load(&self.scene)?;
        let model = Model::load(&self.scene, &file)?;
        let (bounds, origin) = (file.sphere(), file.origin());
        let cameras = file.open(self.dataset.as_deref())?.cameras()?;
        let training: Vec<_> = cameras.iter().map(|camera| camera.about(origin)).collect();
        let up = upwards(&training, bounds.center);
        let cameras = around(&bounds, &training, up, views as usize, size);
        let solid = Solid::new(&model, &file);
        let bar = global.progress("turntable");
        let seen = SeenOnly::of(&solid.scene(&training))?;
        let scene = Scene { shader: &seen, ..solid.scene(&cameras) };
        let sheet = turntable(&scene, self.spp, &bar.mover())?;
        bar.finish_and_clear();
        write_image(&self.output, &sheet)?;
        let (width, height) = (sheet.width, sheet.height);
        let report = TurntableReport { width, height, views: cameras.len(), up: up.to_array() };
        global.report(&report, || format!("{} views, {width} x {height} pixels", cameras.len()))
    }

    /// Renders a scene file.
    fn render_scene<R: ScenePrecision>(&self, global: &Global) -> anyhow::Result<()> {
        let relaxation = R::of(self.relaxation.unwrap_or(1.0));
        let tracing = trace::Options { relaxation, ..Default::default() };
        tracing.validate().map_err(|e| option_error(e.name, e.found, e.expected))?;
        let file = SceneFile::load(&self.scene)?;
        let size = [file.camera.width, file.camera.height];
        check_film(&self.scene, "/camera", size, 1, RENDER_BYTES)?;
        let field = Counted::new(file.field::<R>()?);
        let shader = file.shader::<R>(&field)?;
        let cameras = [file.camera];
        let background = file.background::<R>()?;
        let scene = Scene::new(&field, &*shader, &cameras, &file.bounds, &*background);
        let scene = scene.with_options(tracing).with_slope_of_field(SLOPE_POINTS);
        let bar = global.progress("render");
        let start = Instant::now();
        let film = render(&scene, 0, self.spp, self.seed.unwrap_or(0), &bar.mover())
            .map_err(|e| InputError::new(&self.scene, "/sdf", e, "a finite field"))?
            .film;
        let seconds = start.elapsed().as_secs_f64();
        bar.finish_and_clear();
        write_image(&self.output, &film)?;
        let (width, height) = (film.width, film.height);
        let evaluations = field.evaluations();
        let report = RenderReport { width, height, spp: self.spp, seconds, evaluations };
        global.report(&report, || {
            format!("{width} x {height} pixels, {} samples each, {seconds:.3} s", self.spp)
        })
    }
}
