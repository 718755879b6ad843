//! The optimisation loop.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::checkpoint::{Average, Survey};
use dataset::{Dataset, View};
use estimate::{Estimator, Registry};
use field::BackgroundPerCamera;
use field::{Counted, Evaluations};
use files::{InputError, check_memory};
use film::srgb_decode;
use glam::Vec3;
use loss::photometry::{
    ExposureModel, Gains, Level, MEMORY_PER_PIXEL, MaskUse, Pixel, pyramid, without_gains,
};
use loss::{Batch, BatchStats, Gradient, Observer, Stage, Workspace, gradient};
use multiview::calibrate::{Calibration, CameraDecision};
use optim::Adam;
use random::{Purpose, Stream};
use rayon::prelude::*;
use render::{Camera, InvalidField, Sample, Scene};
use sdf_nn::background::Volume;

use crate::cameras::{Corrections, corrected};
use crate::depths::Depths;
use crate::iteration::Metrics;
use crate::model::{HEAD_BANDS, Model, NETWORK_GROUP};
use crate::run_file::RunFile;
use checkpoints::load_state;
use loss::schedule::{
    background_group, band_window, batch_share, direction_weight, learning_rate, level, sharpness,
};

mod averaging;
mod checkpoints;
mod matching;
mod preview;
mod refinement;
mod survey;

pub use preview::write_preview;

/// The rate at which cameras are refined, in pixels, times the fit's schedule: a tenth of the rate
/// of a trial. Good poses get worse if they are refined fast.
const CAMERA_RATE: f64 = 0.01;

/// The learning rate of the logarithms of exposures, times the fit's schedule.
const GAIN_RATE: f64 = 0.01;

/// The largest number of levels of the pyramid: the coarsest has 1/8 of the size.
const LEVELS: usize = 4;

/// The weight of an iteration in the running mean of the gradient's norm. At 0.02 and 0.15:
/// distance 1.05 and 1.01 (see the evidence in the module `loss::schedule`).
const NORM_SHARE: f32 = 0.05;

/// The share of the largest step of a background's feature that smoothing by one neighbour undoes.
const SMOOTHNESS: f64 = 0.2;

/// Iterations from one smoothing to the next, each of which goes through all features.
const SMOOTH_EVERY: u64 = 4;

/// A fit: a model, its optimiser, and the photographs, with a run folder for its files.
pub struct Fit {
    /// The content of `fit.toml`.
    pub file: RunFile,
    /// The model.
    pub model: Model,
    /// The photographs with their cameras.
    pub dataset: Dataset,
    /// The number of finished iterations.
    pub iteration: u64,
    estimator: Box<dyn Estimator<f32>>,
    folder: PathBuf,
    pub(crate) levels: Vec<Level>,
    /// The background of each view, if the photographs have colours of their own.
    colors: Option<BackgroundPerCamera<f32>>,
    /// The exposures of the photographs, if they are fitted.
    gains: Option<Gains>,
    /// The corrections of the cameras.
    pub(crate) corrections: Corrections,
    /// The decision about the cameras that was made before the next iteration.
    decision: Option<CameraDecision>,
    /// The last survey of the surface.
    survey: Option<Survey>,
    adam: Adam<f32>,
    parameters: Vec<f32>,
    /// The mean of the parameters over the last part of the budget.
    average: Option<Average>,
    /// Wall time of all sessions, in seconds.
    pub(crate) seconds: f64,
    /// The part of it that searches for depths took.
    pub(crate) searching: f64,
    /// The running mean of the gradient's norm; 0 before the first step.
    usual_norm: f32,
    held_out_psnr: Option<f64>,
    /// The depths of the training views, once they were looked for.
    pub(crate) depths: Option<Depths>,
    /// The working memory of gradients.
    work: Workspace,
}

/// The most pixels along a side of a photograph: [`Pixel`] has coordinates of 16 bits.
const MOST_SIDE: u32 = 65535;

/// Refuses a photograph with a side that is too long.
fn check_sides(views: &[View]) -> Result<(), InputError> {
    let is_long = |view: &&View| view.image.width.max(view.image.height) > MOST_SIDE;
    let Some(view) = views.iter().find(is_long) else { return Ok(()) };
    let found = format!("{} x {} pixels", view.image.width, view.image.height);
    let expected = format!("sides of at most {MOST_SIDE} pixels; --downscale N reduces them");
    Err(InputError::new(&view.path, "size", found, expected))
}

impl Fit {
    /// Starts a fit in the run folder `folder`, or with `resume` continues from the checkpoint
    /// there. It writes no file. The estimator named by the options comes from `registry`.
    ///
    /// # Errors
    /// If an option is not valid, a side of a photograph has more than 65,535 pixels, no ray of a
    /// pixel meets the bounding sphere, or the checkpoint cannot be used.
    pub fn new(
        folder: &Path,
        dataset: Dataset,
        file: RunFile,
        registry: &Registry,
        resume: bool,
    ) -> anyhow::Result<Self> {
        let source = folder.join("fit.toml");
        file.options.validate(&source, registry)?;
        let Some(entry) = registry.get(&file.options.estimator) else {
            anyhow::bail!("{}: no estimator {}", source.display(), file.options.estimator);
        };
        let estimator = entry.estimator(&file.options.estimator_options());
        // Before the model, which may be large: the checkpoint tells whether it is that of the run.
        let state = if resume { Some(load_state(folder, &file)?) } else { None };
        let model = Model::initial(&file);
        let parameters = model.parameters();
        let adam = Adam::new(parameters.len(), model.groups());
        let pixels: u64 = dataset.train.iter().map(|v| v.image.pixels.len() as u64).sum();
        let found = format!("{pixels} pixels of photographs");
        check_memory(&file.dataset, "images", found, pixels * MEMORY_PER_PIXEL)?;
        check_sides(&dataset.train)?;
        let background = file.background_model(&dataset.train);
        let colors = file.colors(&background.estimates);
        let levels = pyramid(&dataset.train, file.masks, &background, LEVELS);
        if levels[0].pixel_count() == 0 {
            let expected = "a sphere that the cameras see (option --bounds)";
            return Err(InputError::new(
                &file.dataset,
                "bounds",
                "no pixel whose ray meets the sphere",
                expected,
            )
            .into());
        }
        let is_per_view = file.exposure_model == ExposureModel::PerView;
        let gains = is_per_view.then(|| Gains::new(dataset.train.len()));
        let mut fit = Fit {
            file,
            model,
            dataset,
            iteration: 0,
            estimator,
            folder: folder.to_owned(),
            levels,
            colors,
            gains,
            corrections: Corrections::Undecided,
            decision: None,
            survey: None,
            adam,
            parameters,
            average: None,
            seconds: 0.0,
            searching: 0.0,
            usual_norm: 0.0,
            held_out_psnr: None,
            depths: None,
            work: Workspace::default(),
        };
        if let Some(state) = state {
            fit.restore(state)?;
        }
        fit.set_windows();
        Ok(fit)
    }

    /// Shows the tasks of iterations to an observer, and shares them as for this number of threads.
    pub fn observe(&mut self, workers: usize, observer: Observer) {
        self.work = Workspace::observed(workers, observer);
    }

    /// Wall time of all sessions of the run, in seconds.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// The spent fraction of the budget (time or iterations), from 0; it can exceed 1. The time of
    /// searches for depths shortens the schedule, and is no part of it.
    pub fn progress(&self) -> f64 {
        self.file.options.budget().progress(self.iteration, self.seconds, self.searching)
    }

    /// Runs iterations until the budget is spent or `stop` is true, and saves.
    ///
    /// `report` gets the fit and the metrics after every iteration; its time counts as time of the
    /// fit. The folders `checkpoint` and `preview` must exist in the run folder.
    ///
    /// # Errors
    /// If the field or a gradient is not finite, a file cannot be written, or `report` fails.
    pub fn run(
        &mut self,
        stop: &dyn Fn() -> bool,
        report: &mut dyn FnMut(&Self, &Metrics) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        self.find_depths(stop, &mut |_, _| {});
        let (begin, before) = (Instant::now(), self.seconds);
        while self.progress() < 1.0 && !stop() {
            let mut metrics = self.step()?;
            let taken = begin.elapsed().as_secs_f64() + before - self.seconds;
            metrics.rays_per_second /= taken.max(1e-9);
            self.seconds = before + begin.elapsed().as_secs_f64();
            metrics.seconds = self.seconds;
            metrics.progress = self.progress();
            report(self, &metrics)?;
            if self.iteration.is_multiple_of(self.file.options.preview_every) {
                self.preview()?;
            }
            if self.iteration.is_multiple_of(self.file.options.checkpoint_every) {
                self.save()?;
            }
            self.seconds = before + begin.elapsed().as_secs_f64();
        }
        self.take_average();
        self.save()
    }
}

impl Fit {
    /// One iteration. `rays_per_second` of the result is the number of rays, and `progress` is 0;
    /// the caller completes them.
    fn step(&mut self) -> anyhow::Result<Metrics> {
        let level = level(self.progress(), self.levels.len());
        let trial = self.start_refinement()?;
        self.survey_surface()?;
        let (Gradient { parameters: mut gradient, cameras, gains, stats }, evaluations) =
            self.gradient(level)?;
        let schedule = learning_rate(self.progress());
        let work = std::mem::take(&mut self.work);
        let norm = work.run(Stage::Parameters, || self.move_parameters(&mut gradient, schedule));
        self.work = work;
        let norm = norm?;
        self.work.reuse(gradient);
        if let Some(calibration) = self.corrections.refined_mut() {
            calibration.step(&self.levels[level].cameras, &cameras, CAMERA_RATE * schedule)?;
        }
        if let Some(own) = &mut self.gains {
            own.step(&gains, GAIN_RATE * schedule)?;
        }
        self.iteration += 1;
        self.set_windows();
        Ok(Metrics { trial, ..self.metrics(&stats, evaluations, level, norm) })
    }

    /// Takes a step against the gradient, at this fraction of the learning rate; the network of the
    /// field can have a smaller one. Returns the norm of the gradient before clipping.
    fn move_parameters(&mut self, gradient: &mut [f32], schedule: f64) -> anyhow::Result<f32> {
        let background = self.model.background.parameters().len();
        let shape = gradient.len() - background;
        let norm = self.clip(&mut gradient[..shape]);
        let rate = self.file.options.learning_rate * schedule;
        self.adam.set_rate(NETWORK_GROUP, self.file.options.network_rate(self.progress()));
        self.adam.step(&mut self.parameters, gradient, rate as f32)?;
        if background > 0 && self.iteration.is_multiple_of(SMOOTH_EVERY) {
            let step = SMOOTHNESS * SMOOTH_EVERY as f64 * rate;
            Volume::smooth(&mut self.parameters[shape..], step as f32);
        }
        self.model.set_parameters(&self.parameters);
        self.add_to_average();
        Ok(norm)
    }

    /// The gradient of this iteration's batch, and the number of its field evaluations.
    fn gradient(&mut self, level: usize) -> anyhow::Result<(Gradient, Evaluations)> {
        let (pixels, count) = self.draw(level);
        let stream = Stream::new(self.file.options.seed, Purpose::Iteration);
        let seed = stream.at(self.iteration).bits();
        let mut work = std::mem::take(&mut self.work);
        let calibration = self.corrections.calibration();
        let found = self.gradient_of(level, (&pixels, count), calibration, seed, &mut work);
        self.work = work;
        found
    }

    /// The gradient of a batch, with cameras that are corrected by `calibration`. `pixels` come
    /// with the number of pixels that they stand for.
    fn gradient_of(
        &self,
        level: usize,
        (pixels, pixel_count): (&[Pixel], f32),
        calibration: Option<&Calibration>,
        seed: u64,
        work: &mut Workspace,
    ) -> anyhow::Result<(Gradient, Evaluations)> {
        let options = &self.file.options;
        let counted = Counted::new(&self.model.field);
        let cameras = corrected(calibration, &self.levels[level].cameras);
        let scene = scene(&self.model, &self.file, &cameras);
        let behind = (self.file.masks == MaskUse::Coverage).then(|| self.random_colors(seed));
        let factors = self.factors();
        let colors = behind.as_ref().or(self.colors.as_ref());
        // The photographs show these colours as they are.
        let divided = without_gains(colors, &factors);
        let colors = divided.as_ref().or(colors);
        let trained = self.model.background.jittered(seed);
        let trained = trained.as_ref().map_or(scene.background, |trained| trained);
        let background = colors.map_or(trained, |colors| colors);
        let batch = Batch {
            scene: Scene { field: &counted, background, ..scene },
            level: &self.levels[level],
            pixels,
            pixel_count,
            trains_background: self.file.background_kind.is_trained(),
            refines_cameras: calibration.is_some() && self.corrections.adjusted().is_none(),
            behind: behind.as_ref().map_or(&[], |colors| &colors.0),
            gains: &factors,
            eikonal: options.eikonal as f32,
            bending: options.bending_weight(self.progress()) as f32,
            estimator: &*self.estimator,
            counts: options.counts(),
            pass: options.pass(),
            sharpness: sharpness(self.progress(), options.soft()),
            depths: self.guide(level),
            carves: self.carves(),
            seed,
        };
        Ok((gradient(&batch, work)?, counted.evaluations()))
    }

    /// A random colour for each view, uniform in display space.
    fn random_colors(&self, seed: u64) -> BackgroundPerCamera<f32> {
        let stream = Stream::new(seed, Purpose::BackgroundColor);
        let channel = |view: u64, c: u64| srgb_decode(stream.at(view).at(c).unit() as f32);
        let color = |view| Vec3::from([0, 1, 2].map(|c| channel(view, c)));
        BackgroundPerCamera((0..self.dataset.train.len() as u64).map(color).collect())
    }

    /// Clips the gradient of the field and the radiance head to the multiple of the running mean of
    /// its norm that the options give, updates the running mean, and returns the norm before
    /// clipping. The first gradient is not clipped.
    fn clip(&mut self, gradient: &mut [f32]) -> f32 {
        let known = self.usual_norm > 0.0;
        let limit = self.file.options.clip as f32 * self.usual_norm;
        let norm = optim::clip_norm(gradient, if known { limit } else { f32::MAX });
        let kept = norm.min(if known { limit } else { norm });
        let share = if known { NORM_SHARE } else { 1.0 };
        self.usual_norm += share * (kept - self.usual_norm);
        norm
    }

    /// Sets the weights of the octaves of both encodings and of the view direction for the current
    /// progress. They are part of the saved function, so a resumed fit must have the same.
    fn set_windows(&mut self) {
        let (progress, options) = (self.progress(), &self.file.options);
        let window = |bands| band_window(progress, bands);
        self.model.field.set_band_weights(&window(options.bands));
        let direction = direction_weight(progress, options.soft());
        self.model.head.set_input_weights(&window(HEAD_BANDS), direction);
    }

    /// The pixels of this iteration, and the expected number of pixels that they stand for.
    fn draw(&self, level: usize) -> (Vec<Pixel>, f32) {
        // Coarse images have few pixels: level 1 has half of the batch, coarser levels a quarter.
        let share = batch_share(self.progress(), self.file.options.soft());
        let batch = share * (self.file.options.batch >> level.min(2)) as f64;
        let batch = (batch as u64).max(1);
        let level_pixels = &self.levels[level];
        let every = background_group(self.progress());
        let draws = level_pixels.draws_for(batch, every);
        let seed = self.file.options.seed;
        let stream = Stream::new(seed, Purpose::PixelOrder).at(level as u64);
        let pixels = (0..draws as usize)
            .into_par_iter()
            .with_min_len(DRAWS)
            .map(|i| level_pixels.draw(self.iteration * draws + i as u64, every, stream))
            .collect();
        (pixels, level_pixels.count_of(draws, every) as f32)
    }

    fn metrics(
        &self,
        stats: &BatchStats,
        evaluations: Evaluations,
        level: usize,
        norm: f32,
    ) -> Metrics {
        let n = stats.pixels as f64;
        Metrics {
            iteration: self.iteration,
            seconds: self.seconds,
            progress: 0.0,
            loss: stats.photometric / n,
            eikonal: stats.eikonal / stats.eikonal_points.max(1) as f64,
            train_psnr: -10.0 * (stats.squared_error / n).max(1e-10).log10(),
            psnr: self.held_out_psnr,
            evaluations,
            rays_per_second: stats.rays as f64,
            edge_fraction: stats.edge_pixels as f64 / n,
            level,
            gradient_norm: norm.into(),
            trial: None,
        }
    }
}

impl Fit {
    /// Whether the ray through the centre of a pixel of a training view hits the surface.
    ///
    /// The pixels of the coarsest level are tried first, then those of the photographs.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity along a ray.
    pub fn has_visible_surface(&self) -> Result<bool, InvalidField> {
        let any_hit = |level: &Level| {
            let scene = scene(&self.model, &self.file, &level.cameras);
            let samples: Vec<Sample> = level.centers().collect();
            let hit = |samples: &[Sample]| match scene.primary(samples) {
                Ok(primary) => (!primary.hits.is_empty()).then_some(Ok(true)),
                Err(error) => Some(Err(error)),
            };
            samples.par_chunks(TRACED_CHUNK).find_map_first(hit).unwrap_or(Ok(false))
        };
        let coarsest = self.levels.len() - 1;
        Ok(any_hit(&self.levels[coarsest])? || (coarsest > 0 && any_hit(&self.levels[0])?))
    }
}

/// Pixels that a thread draws at a time, at least.
const DRAWS: usize = 64;

/// Rays that a thread traces together.
const TRACED_CHUNK: usize = 1024;

/// Points at which the slope of the field is taken: a hundredth of the evaluations of an iteration.
pub(crate) const SLOPE_POINTS: u64 = 128;

/// The scene that a run fits: its model in front of its background, in its bounding sphere, without
/// the cap of a [`Solid`]. Rays start with the slope that the field has now.
fn scene<'a>(model: &'a Model, file: &RunFile, cameras: &'a [Camera]) -> Scene<'a, f32> {
    let background = model.background.as_background();
    Scene::new(&model.field, &model.head, cameras, &file.sphere(), background)
        .with_slope_of_field(SLOPE_POINTS)
}
