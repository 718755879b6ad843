//! One iteration of a fit: the way of a pixel from its draw to a step of the parameters.

use field::Evaluations;
use loss::photometry::Draw;
use loss::schedule::{background_group, batch_share, learning_rate, pyramid_level, sharpness};
use loss::{Gradient, Stage, Workspace, balanced};
use multiview::calibrate::CameraDecision;
use random::{Name, Stream};
use rayon::prelude::*;
use render::Sample;

use crate::camera_trial::start_refinement;
use crate::error::FitError;
use crate::fit::Fit;
use crate::lattice::{FieldLattice, PERIOD};
use crate::metrics::StepMetrics;
use crate::objective::{DrawnPixels, differentiate};
use crate::optimiser::StepTime;
use crate::survey::survey_surface;

/// The rate at which cameras are refined, in pixels, times the fit's schedule: a tenth of the rate
/// of a trial. Good poses get worse if they are refined fast.
const CAMERA_RATE: f64 = 0.01;

/// The learning rate of the logarithms of exposures, times the fit's schedule.
const GAIN_RATE: f64 = 0.01;

/// Steps of the length of a ray in the ball, per bounding radius.
const WAY_STEPS: f64 = 64.0;

/// Pixels that a thread draws at a time, at least.
const DRAWS: usize = 64;

const PIXEL_ORDER: Name = Name::new("order in which a fit draws pixels", 10);
const ITERATION: Name = Name::new("iterations of a fit", 13);

impl Fit {
    /// One iteration. A pixel passes through these stages:
    ///
    /// | stage | where | value |
    /// | --- | --- | --- |
    /// | drawn | `draw` | the pixels of this iteration, on a level of the pyramid |
    /// | traced, shaded, compared, reversed, added | [`loss::gradient()`] | [`Gradient`]: the gradient of the total loss |
    /// | stepped | here | parameters, cameras and exposures after a step against it |
    ///
    /// `work` is memory that the next iteration uses again.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity along a ray, or a gradient is not finite.
    pub fn step(&mut self, work: &mut Workspace) -> Result<StepMetrics, FitError> {
        let trial = start_refinement(self)?;
        survey_surface(self)?;
        work.run(Stage::Caller, || self.refresh_lattice());

        work.run(Stage::Caller, || self.prepare_patches());

        let drawn = work.run(Stage::Caller, || draw(self));

        let stream = Stream::of_seed(self.file.options.seed).named(ITERATION);
        let stream = stream.at(self.clock.iteration);
        let calibration = self.photographs.corrections.get();
        let (mut added, evaluations) = differentiate(self, &drawn, calibration, stream, work)?;

        let norm = self.take_step(&drawn, &mut added, work)?;
        let metrics = self.metrics(&added, evaluations, drawn.level, norm, trial);
        work.reuse(added.parameters);
        Ok(metrics)
    }

    /// Makes ready the comparison of patches, once the surface is sharp at full size.
    fn prepare_patches(&mut self) {
        let (progress, options) = (self.progress(), &self.file.options);
        let is_sharp = sharpness(progress, options.soft()).is_none();
        let level = pyramid_level(progress, self.photographs.levels.len());
        if is_sharp && level == 0 && options.patch_weight() > 0.0 {
            self.photographs.prepare_consistency(&self.file.sphere());
        }
    }

    /// Makes a lattice of the field, if it is time: rays of a sharp surface skip empty space by it.
    /// It trusts the change of f between two times, so these are always as far apart.
    fn refresh_lattice(&mut self) {
        let is_sharp = sharpness(self.progress(), self.file.options.soft()).is_none();
        if !is_sharp || self.estimator.reach().is_none() {
            self.lattice = None;
        } else if self.clock.iteration.is_multiple_of(PERIOD) {
            let (last, ball) = (self.lattice.take(), self.ball());
            self.lattice = Some(FieldLattice::after(last, &self.model, &ball));
        }
    }

    /// Takes a step against a gradient. Returns the norm of the gradient by field and radiance,
    /// before clipping.
    fn take_step(
        &mut self,
        drawn: &DrawnPixels,
        added: &mut Gradient,
        work: &Workspace,
    ) -> Result<f32, FitError> {
        let (iteration, progress) = (self.clock.iteration, self.progress());
        let schedule = learning_rate(progress);
        let Fit { file, model, optimiser, photographs, .. } = self;
        let time = StepTime { iteration, progress, schedule };
        let gradient = &mut added.parameters;
        let step = || optimiser.step(model, gradient, &file.options, time);
        let norm = work.run(Stage::Caller, step)?;

        if let Some(calibration) = photographs.corrections.refined_mut() {
            let cameras = &photographs.levels[drawn.level].cameras;
            calibration.step(cameras, &added.cameras, CAMERA_RATE * schedule)?;
        }
        if let Some(gains) = &mut photographs.gains {
            gains.step(&added.gains, GAIN_RATE * schedule)?;
        }

        self.clock.iteration += 1;
        self.set_windows();
        Ok(norm)
    }

    fn metrics(
        &self,
        Gradient { stats, .. }: &Gradient,
        evaluations: Evaluations,
        level: usize,
        norm: f32,
        trial: Option<CameraDecision>,
    ) -> StepMetrics {
        let n = stats.pixels as f64;
        StepMetrics {
            iteration: self.clock.iteration,
            loss: stats.photometric / n,
            eikonal: stats.eikonal / stats.eikonal_points.max(1) as f64,
            train_psnr: -10.0 * (stats.squared_error / n).max(1e-10).log10(),
            evaluations,
            rays: stats.rays,
            edge_fraction: stats.edge_pixels as f64 / n,
            level,
            gradient_norm: norm.into(),
            trial,
        }
    }
}

/// Draws the pixels of an iteration.
fn draw(fit: &Fit) -> DrawnPixels {
    let (progress, options) = (fit.progress(), &fit.file.options);
    let level = pyramid_level(progress, fit.photographs.levels.len());
    // Coarse images have few pixels: level 1 has half of the batch, coarser levels a quarter.
    let share = batch_share(progress, options.soft());
    let batch = share * (options.batch >> level.min(2)) as f64;
    let batch = (batch as u64).max(1);

    let pixels = &fit.photographs.levels[level];
    let every = background_group(progress);
    let count = pixels.draws_for(batch, every);
    let stream = Stream::of_seed(options.seed).named(PIXEL_ORDER).at(level as u64);
    let draws: Vec<Draw> = (0..count as usize)
        .into_par_iter()
        .with_min_len(DRAWS)
        .map(|i| pixels.draw(fit.clock.iteration * count + i as u64, every, stream))
        .collect();
    // A ray takes about as long as its way through the ball. In whole steps, so that the rounding of
    // a distant place does not change the order.
    let ball = fit.file.sphere();
    let way = |draw: &Draw| {
        let Sample { camera, u } = draw.center();
        let camera = &pixels.cameras[camera];
        let ends = ball.clip(camera.eye, camera.direction(u));
        ends.map_or(0.0, |(near, far)| ((far - near) / ball.radius * WAY_STEPS).round())
    };
    let draws = balanced(&draws, way);
    DrawnPixels { level, draws, pixel_count: pixels.count_of(count, every) as f32 }
}
