//! The optimisation loop.

use std::path::{Path, PathBuf};
use std::time::Instant;

use field::{Counted, Evaluations, Field};
use glam::Vec3;
use optim::{Adam, Group};
use serde::Serialize;
use warp::Weighting;

use super::checkpoint::State;
use super::model::{HEAD_BANDS, Model, RunFile};
use super::pyramid::{Level, Pixel, pyramid};
use super::step::{Batch, LIMIT, Tally, gradient};
use super::{DEFAULT_ITERATIONS, schedule, write_preview};
use dataset::Dataset;
use estimate::Setup;
use io::InputError;
use metrics::psnr;
use random::mix;
use render::Camera;

/// The most the pyramid is coarsened: 1/8 of the size.
const LEVELS: usize = 4;

/// The norm to which an iteration's gradient is clipped, as a multiple of its running mean.
const CLIP: f32 = 3.0;

/// The share of an iteration in the running mean of the gradient's norm.
const NORM_SHARE: f32 = 0.05;

/// One line of `metrics.jsonl`.
#[derive(Clone, Debug, Serialize)]
pub struct Metrics {
    /// Iterations done.
    pub iteration: u64,
    /// Seconds spent in all.
    pub seconds: f64,
    /// The fraction of the budget spent.
    pub progress: f64,
    /// Mean photometric loss a pixel.
    pub loss: f64,
    /// Mean of (|∇f| − 1)².
    pub eikonal: f64,
    /// PSNR over the iteration's own pixels, dB.
    pub train_psnr: f64,
    /// PSNR of the held-out view last rendered, dB; absent without one.
    pub psnr: Option<f64>,
    /// Field evaluations of the iteration.
    pub evaluations: Evaluations,
    /// Rays traced a second.
    pub rays_per_second: f64,
    /// Fraction of the pixels that a silhouette may have crossed.
    pub edge_fraction: f64,
    /// The pyramid's level: images at 1/2^level.
    pub level: usize,
    /// The norm of the gradient before clipping.
    pub gradient_norm: f64,
}

/// A fit: a model, its optimiser, and the photographs.
pub struct Fit {
    /// What the run was given.
    pub file: RunFile,
    /// The model.
    pub model: Model,
    /// The data set.
    pub dataset: Dataset,
    /// Iterations done.
    pub iteration: u64,
    /// Weights of the warp other than the published ones.
    pub weighting: Option<&'static dyn Weighting<f32>>,
    folder: PathBuf,
    levels: Vec<Level>,
    adam: Adam<f32>,
    parameters: Vec<f32>,
    seconds: f64,
    /// The running mean of the gradient's norm; 0 before the first step.
    usual_norm: f32,
    held_out_psnr: Option<f64>,
}

impl Fit {
    /// Starts a fit in `folder`, or goes on from the checkpoint there if `resume`.
    ///
    /// # Errors
    /// If the checkpoint cannot be used.
    pub fn new(
        folder: &Path,
        dataset: Dataset,
        file: RunFile,
        resume: bool,
    ) -> anyhow::Result<Self> {
        let bounds = file.sphere();
        let model = Model::initial(&file.options, &bounds);
        let parameters = model.parameters();
        let fields = Field::<f32>::parameter_count(&model.field);
        let adam = Adam::new(
            parameters.len(),
            vec![Group::new("field", 0..fields), Group::new("radiance", fields..parameters.len())],
        );
        let levels = pyramid(&dataset.train, &file.backdrop(), LEVELS);
        if levels[0].pixel_count() == 0 {
            let expected = "a sphere in sight of the cameras (see --bounds)";
            return Err(InputError::new(
                &file.dataset,
                "bounds",
                "no pixel whose ray meets the sphere",
                expected,
            )
            .into());
        }
        let mut fit = Fit {
            file,
            model,
            dataset,
            iteration: 0,
            weighting: None,
            folder: folder.to_owned(),
            levels,
            adam,
            parameters,
            seconds: 0.0,
            usual_norm: 0.0,
            held_out_psnr: None,
        };
        if resume {
            fit.restore()?;
        }
        fit.set_windows();
        Ok(fit)
    }

    fn checkpoint_path(&self) -> PathBuf {
        self.folder.join("checkpoint").join("state.safetensors")
    }

    fn restore(&mut self) -> anyhow::Result<()> {
        let state = State::load(&self.checkpoint_path(), self.parameters.len())?;
        if let Some(budget) = self.file.options.iterations.filter(|n| *n < state.iteration) {
            let expected = format!("at least the {} that are done", state.iteration);
            return Err(InputError::new(
                self.folder.join("fit.toml"),
                "iterations",
                budget,
                expected,
            )
            .into());
        }
        self.adam.restore(&state.first, &state.second, state.steps)?;
        self.model.set_parameters(&state.parameters);
        self.parameters = state.parameters;
        self.iteration = state.iteration;
        self.seconds = state.seconds;
        self.usual_norm = state.usual_norm;
        Ok(())
    }

    /// Writes the checkpoint and the model files.
    ///
    /// # Errors
    /// If a file cannot be written; the files before stay whole.
    pub fn save(&self) -> anyhow::Result<()> {
        let (first, second, steps) = self.adam.state();
        let state = State {
            iteration: self.iteration,
            seconds: self.seconds,
            usual_norm: self.usual_norm,
            parameters: self.parameters.clone(),
            first: first.to_vec(),
            second: second.to_vec(),
            steps,
        };
        state.save(&self.checkpoint_path())?;
        self.model.save(&self.folder)
    }

    /// Seconds spent in all.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// The fraction of the budget that is spent.
    pub fn progress(&self) -> f64 {
        match (self.file.options.time, self.file.options.iterations) {
            (Some(time), _) => self.seconds / time.as_secs_f64(),
            (None, iterations) => {
                self.iteration as f64 / iterations.unwrap_or(DEFAULT_ITERATIONS) as f64
            }
        }
    }

    /// Runs until the budget is spent, or `stop` says so, and saves. `tell` hears of every
    /// iteration; time spent in it counts as spent.
    ///
    /// # Errors
    /// If the field or a gradient stops being finite, or a file cannot be written.
    pub fn run(
        &mut self,
        stop: &dyn Fn() -> bool,
        tell: &mut dyn FnMut(&Metrics) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let (begin, before) = (Instant::now(), self.seconds);
        while self.progress() < 1.0 && !stop() {
            let mut metrics = self.step()?;
            let taken = begin.elapsed().as_secs_f64() + before - self.seconds;
            metrics.rays_per_second /= taken.max(1e-9);
            self.seconds = before + begin.elapsed().as_secs_f64();
            metrics.seconds = self.seconds;
            metrics.progress = self.progress();
            tell(&metrics)?;
            if self.iteration.is_multiple_of(self.file.options.preview_every) {
                self.preview()?;
            }
            if self.iteration.is_multiple_of(self.file.options.checkpoint_every) {
                self.save()?;
            }
            self.seconds = before + begin.elapsed().as_secs_f64();
        }
        self.save()
    }
}

impl Fit {
    /// One iteration. The metrics' `rays_per_second` holds the number of rays; the caller knows the
    /// time.
    fn step(&mut self) -> anyhow::Result<Metrics> {
        let options = &self.file.options;
        let progress = self.progress();
        let level = schedule::level(progress, self.levels.len());
        let seed = mix(options.seed, self.iteration);
        let (pixels, pixel_count) = self.draw(level);
        let weights =
            schedule::weights(progress, options, f64::from(self.file.background_confidence));
        let estimator = options.estimator();
        let counted = Counted::new(&self.model.field);
        let mut setup = self.setup(&self.levels[level].cameras);
        setup.field = &counted;
        let batch = Batch {
            setup,
            level: &self.levels[level],
            pixels: &pixels,
            pixel_count,
            backdrop: self.file.backdrop(),
            weights,
            estimator: &*estimator,
            limit: LIMIT,
            seed,
        };
        let (mut gradient, tally) = gradient(&batch)?;
        let evaluations = counted.evaluations();
        let norm = optim::clip_norm(
            &mut gradient,
            if self.usual_norm > 0.0 { CLIP * self.usual_norm } else { f32::MAX },
        );
        let kept = norm.min(if self.usual_norm > 0.0 { CLIP * self.usual_norm } else { norm });
        let share = if self.usual_norm > 0.0 { NORM_SHARE } else { 1.0 };
        self.usual_norm += share * (kept - self.usual_norm);
        let rate = options.learning_rate * schedule::learning_rate(progress);
        self.adam.step(&mut self.parameters, &gradient, rate as f32)?;
        self.model.set_parameters(&self.parameters);
        self.iteration += 1;
        self.set_windows();
        Ok(self.metrics(&tally, evaluations, level, norm))
    }

    /// Fades in the octaves of both encodings as far as the fit has come. Part of the function that
    /// is saved, so it has to be the same after a restart.
    fn set_windows(&mut self) {
        let progress = self.progress();
        self.model
            .field
            .set_band_weights(&schedule::band_window(progress, self.file.options.bands));
        self.model.head.set_band_weights(&schedule::band_window(progress, HEAD_BANDS));
    }

    /// The pixels of this iteration, and how many they stand for.
    fn draw(&self, level: usize) -> (Vec<Pixel>, f32) {
        // Coarse images have few pixels: a quarter of the batch goes twice as far.
        let batch = (self.file.options.batch as u64 >> level.min(2)).max(1);
        let level_pixels = &self.levels[level];
        let every = schedule::plain(self.progress());
        let (draws, seed) =
            (level_pixels.draws_for(batch, every), mix(self.file.options.seed, level as u64));
        let pixels = (0..draws)
            .map(|i| level_pixels.draw(self.iteration * draws + i, every, seed))
            .collect();
        (pixels, level_pixels.count_of(draws, every) as f32)
    }

    fn metrics(&self, tally: &Tally, evaluations: Evaluations, level: usize, norm: f32) -> Metrics {
        let n = tally.pixels as f64;
        Metrics {
            iteration: self.iteration,
            seconds: self.seconds,
            progress: 0.0,
            loss: tally.photometric / n,
            eikonal: tally.eikonal / tally.eikonal_points.max(1) as f64,
            train_psnr: -10.0 * (tally.squared_error / n).max(1e-10).log10(),
            psnr: self.held_out_psnr,
            evaluations: evaluations,
            rays_per_second: tally.rays as f64,
            edge_fraction: tally.edge_pixels as f64 / n,
            level,
            gradient_norm: norm.into(),
        }
    }

    /// The setup for cameras of this data set.
    pub fn setup<'a>(&'a self, cameras: &'a [Camera]) -> Setup<'a, f32> {
        let mut setup = setup(&self.model, &self.file, cameras);
        setup.weighting = self.weighting.map(|w| w as _);
        setup
    }

    /// PSNR of the held-out view last rendered, dB.
    pub fn held_out_psnr(&self) -> Option<f64> {
        self.held_out_psnr
    }

    /// Writes the preview picture of the view that stands for the others, a held-out one if there
    /// is one, and remembers its PSNR for the metrics.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity, or the picture cannot be written.
    pub fn preview(&mut self) -> anyhow::Result<()> {
        let held_out = self.dataset.test.first();
        let Some(view) = held_out.or(self.dataset.train.first()) else { return Ok(()) };
        let cameras = [view.camera];
        let path = self.folder.join("preview").join(format!("{:06}.png", self.iteration));
        let image = write_preview(&path, &self.setup(&cameras), 0, &view.image)?;
        self.held_out_psnr = held_out.map(|view| psnr(&image, &view.image));
        Ok(())
    }
}

/// What the estimators need to render a run's model.
pub fn setup<'a>(model: &'a Model, file: &RunFile, cameras: &'a [Camera]) -> Setup<'a, f32> {
    let (options, sphere) = (&file.options, file.sphere());
    let mut setup =
        Setup::new(&model.field, &model.head, cameras, &sphere, Vec3::from(file.background));
    setup.steps = options.steps;
    setup.warp = warp::Options {
        k: options.top_k,
        gamma: options.gamma as f32,
        lambda_d: (options.lambda_d * sphere.radius) as f32,
        epsilon: (options.epsilon * sphere.radius) as f32,
        ..warp::Options::default()
    };
    setup
}
