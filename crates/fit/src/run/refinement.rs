//! The start of the refinement of cameras: at once, or after a trial on a copy.

use crate::checkpoint::{Optimised, Refinement};
use files::InputError;
use glam::Vec3;
use loss::photometry::{Gains, Pixel, photometric, without_gains};
use loss::{Gradient, Workspace};
use multiview::calibrate::{Calibration, CameraDecision, Freedom, RefineCameras, Trial};
use random::{Purpose, Stream};
use render::{InvalidField, Sample};

use super::checkpoints::checkpoint_path;
use super::{Fit, scene};
use crate::cameras::{Corrections, calibration, corrected};
use crate::exposure::RunExposures;
use crate::run_cameras::RunCameras;

/// The share of the sharp part of the budget before the refinement of cameras: the surface has
/// become sharp by then.
const AFTER_SOFT: f64 = 0.1;

/// The largest number of steps of a trial.
const TRIAL_STEPS: u64 = 200;

/// The least number of steps of a trial. Shorter ones find nothing.
const LEAST_STEPS: u64 = 20;

/// Iterations of the fit so far for each step of a trial: a trial takes less than 2 % of the
/// budget.
const ITERATIONS_PER_STEP: u64 = 32;

/// The rate of the first step of a trial, in pixels; it falls to zero.
const TRIAL_RATE: f64 = 0.1;

/// Pixels of each view on which the result of a trial is measured.
const TRIAL_PIXELS: u64 = 128;

impl Fit {
    /// Starts the refinement of the cameras once it is time. Returns the decision, if it was open
    /// and was made now.
    pub(super) fn start_refinement(&mut self) -> anyhow::Result<Option<CameraDecision>> {
        if let Some(decision) = self.decision.take() {
            return Ok(Some(decision));
        }
        let options = &self.file.options;
        let Some(freedom) = options.refine_cameras.freedom() else { return Ok(None) };
        let is_time = self.progress() >= options.soft() + (1.0 - options.soft()) * AFTER_SOFT;
        if !is_time || !self.corrections.is_undecided() || !self.estimator.differentiates_cameras()
        {
            return Ok(None);
        }
        self.corrections = Corrections::Given;
        let start = calibration(&self.dataset.train, self.file.sphere(), freedom);
        if options.refine_cameras != RefineCameras::Auto {
            self.corrections = Corrections::Refined(self.trial(start, TRIAL_STEPS)?.0);
            return Ok(None);
        }
        let steps = (self.iteration / ITERATIONS_PER_STEP).min(TRIAL_STEPS);
        if self.dataset.train.len() < 2 {
            return Ok(None);
        }
        if steps < LEAST_STEPS {
            let least = LEAST_STEPS * ITERATIONS_PER_STEP;
            return Ok(Some(CameraDecision::TooShort { iterations: self.iteration, least }));
        }
        let (refined, trial) = self.trial(start, steps)?;
        if trial.is_kept {
            self.corrections = Corrections::Refined(refined);
        }
        Ok(Some(CameraDecision::Trial(trial)))
    }

    /// Restores the state of a checkpoint.
    pub(super) fn restore_refinement(&mut self, state: Refinement) -> anyhow::Result<()> {
        let by_loss = self.file.options.refine_cameras.freedom();
        self.corrections = match state {
            Refinement::Undecided => Corrections::Undecided,
            Refinement::Given => Corrections::Given,
            Refinement::Refined(state) => Corrections::Refined(self.restored(by_loss, &state)?),
            Refinement::Adjusted(state) => {
                Corrections::Adjusted(self.restored(self.freedom_by_places(), &state)?)
            }
        };
        Ok(())
    }

    /// The calibration of a checkpoint, with these free parameters.
    fn restored(
        &self,
        freedom: Option<Freedom>,
        state: &Optimised,
    ) -> Result<Calibration, InputError> {
        let path = checkpoint_path(&self.folder);
        let wrong = |found: &dyn std::fmt::Display, expected: &str| {
            InputError::new(&path, "cameras", found, expected)
        };
        let Some(freedom) = freedom else {
            return Err(wrong(&"refined", "given, by refine_cameras of fit.toml"));
        };
        let mut calibration = calibration(&self.dataset.train, self.file.sphere(), freedom);
        let [parameters, first, second] = state.parts();
        calibration
            .restore(parameters, first, second, state.steps)
            .map_err(|e| wrong(&e, "the refinement of this run's cameras"))?;
        Ok(calibration)
    }

    /// The gain of each photograph, if they are fitted; else empty.
    pub(super) fn factors(&self) -> Vec<Vec3> {
        self.gains.as_ref().map(Gains::factors).unwrap_or_default()
    }

    /// The state of the exposures, for a checkpoint.
    pub(super) fn exposures_state(&self) -> Option<Optimised> {
        self.gains.as_ref().map(|gains| Optimised::new(gains.state()))
    }

    /// Restores the exposures of a checkpoint.
    pub(super) fn restore_exposures(&mut self, state: Option<&Optimised>) -> anyhow::Result<()> {
        let path = checkpoint_path(&self.folder);
        let wrong = |found: &dyn std::fmt::Display, expected: &str| {
            InputError::new(&path, "exposures", found, expected)
        };
        match (&mut self.gains, state) {
            (None, None) => Ok(()),
            (Some(gains), Some(state)) => {
                let [logarithms, first, second] = state.parts();
                let restored = gains.restore(logarithms, first, second, state.steps);
                Ok(restored.map_err(|e| wrong(&e, "the exposures of this run's photographs"))?)
            }
            (Some(_), None) => Err(wrong(&"nothing", "exposures, as in fit.toml").into()),
            (None, Some(_)) => Err(wrong(&"exposures", "none, as in fit.toml").into()),
        }
    }

    /// Writes `exposures.json`, if exposures are fitted.
    pub(super) fn save_exposures(&self) -> anyhow::Result<()> {
        self.exposures().map_or(Ok(()), |exposures| exposures.save(&self.folder))
    }

    /// The exposures as they are fitted so far; `None` if they are equal.
    pub fn exposures(&self) -> Option<RunExposures> {
        self.gains.as_ref().map(|gains| RunExposures::new(&self.dataset.train, gains))
    }

    /// Writes `cameras.json`, if cameras are refined.
    pub(super) fn save_cameras(&self) -> anyhow::Result<()> {
        self.cameras().map_or(Ok(()), |cameras| cameras.save(&self.folder))
    }

    /// The cameras as they are refined so far; `None` if they are those of the data set.
    pub fn cameras(&self) -> Option<RunCameras> {
        let of = |c| RunCameras::new(&self.dataset.train, c, self.file.origin());
        self.corrections.calibration().map(of)
    }

    /// Refines cameras for some steps, with the model as it is.
    fn trial(&self, mut refined: Calibration, steps: u64) -> anyhow::Result<(Calibration, Trial)> {
        let stream = Stream::new(self.file.options.seed, Purpose::CameraTrial);
        let draws = self.file.options.batch as u64;
        let mut work = Workspace::default();
        for step in 0..steps {
            let pixels = self.trial_pixels(step * draws..(step + 1) * draws, stream.at(0));
            let count = pixels.iter().map(|p| f32::from(p.count)).sum();
            let seed = stream.at(1).at(step).bits();
            let (Gradient { cameras, parameters, .. }, _) =
                self.gradient_of(0, (&pixels, count), Some(&refined), seed, &mut work)?;
            work.reuse(parameters);
            let rate = TRIAL_RATE * (1.0 - step as f64 / steps as f64);
            refined.step(&self.levels[0].cameras, &cameras, rate)?;
        }
        let views = self.dataset.train.len() as u64;
        let pixels = self.trial_pixels(0..TRIAL_PIXELS * views, stream.at(2));
        let given = self.residuals(&pixels, None)?;
        let now = self.residuals(&pixels, Some(&refined))?;
        let pairs = given.iter().zip(&now).filter_map(|(a, b)| Some((((*a)?), (*b)?)));
        let (given, now): (Vec<f64>, Vec<f64>) = pairs.unzip();
        let trial = Trial::of(&given, &now, &refined);
        Ok((refined, trial))
    }

    fn trial_pixels(&self, draws: std::ops::Range<u64>, stream: Stream) -> Vec<Pixel> {
        let every = loss::schedule::background_group(1.0);
        draws.map(|i| self.levels[0].draw(i, every, stream)).collect()
    }

    /// The mean residual of each view over these pixels of the photographs; `None` for a view
    /// without one.
    fn residuals(
        &self,
        pixels: &[Pixel],
        calibration: Option<&Calibration>,
    ) -> Result<Vec<Option<f64>>, InvalidField> {
        let level = &self.levels[0];
        let cameras = corrected(calibration, &level.cameras);
        let scene = scene(&self.model, &self.file, &cameras);
        let factors = self.factors();
        let divided = without_gains(self.colors.as_ref(), &factors);
        let colors = divided.as_ref().or(self.colors.as_ref());
        let background = colors.map_or(scene.background, |colors| colors);
        let scene = render::Scene { background, ..scene };
        let samples: Vec<Sample> = pixels.iter().map(Pixel::center).collect();
        let gain = |p: &Pixel| factors.get(p.view as usize).copied().unwrap_or(Vec3::ONE);
        let mut sums = vec![(0.0, 0.0); cameras.len()];
        for (pixels, samples) in pixels.chunks(CHUNK).zip(samples.chunks(CHUNK)) {
            let primary = scene.primary(samples)?;
            for (p, traced) in pixels.iter().zip(&primary.samples) {
                let target = level.photographs[p.view as usize].target(Vec3::ZERO, p);
                let (loss, _) = photometric((traced.radiance * gain(p)).into(), &target);
                let (sum, count) = &mut sums[p.view as usize];
                *sum += f64::from(loss) * f64::from(p.count);
                *count += f64::from(p.count);
            }
        }
        Ok(sums.into_iter().map(|(sum, count)| (count > 0.0).then(|| sum / count)).collect())
    }
}

/// Rays that are traced together.
const CHUNK: usize = 1024;
