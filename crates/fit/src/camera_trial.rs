//! The start of the refinement of cameras: at once, or after a trial on a copy.

use glam::Vec3;
use loss::photometry::{Draw, photometric, without_gains};
use loss::schedule::background_group;
use loss::{Gradient, Workspace};
use multiview::calibrate::{Calibration, CameraDecision, RefineCameras, Trial};
use random::Stream;
use render::{InvalidField, Sample, Scene};

use crate::camera_corrections::Corrections;
use crate::cameras::{calibration, corrected};
use crate::error::FitError;
use crate::fit::{Fit, TRACED_CHUNK};
use crate::objective::{DrawnPixels, differentiate};
use crate::streams::CAMERA_TRIAL;

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

/// Starts the refinement of the cameras once it is time. Returns the decision if this call makes
/// it.
pub(crate) fn start_refinement(fit: &mut Fit) -> Result<Option<CameraDecision>, FitError> {
    if let Some(decision) = fit.photographs.decision.take() {
        return Ok(Some(decision));
    }
    let options = &fit.file.options;
    let Some(freedom) = options.refine_cameras.freedom() else { return Ok(None) };
    let is_time = fit.progress() >= options.soft() + (1.0 - options.soft()) * AFTER_SOFT;
    let is_open = fit.photographs.corrections.is_undecided();
    if !is_time || !is_open || !fit.estimator.differentiates_cameras() {
        return Ok(None);
    }

    fit.photographs.corrections = Corrections::Given;
    let start = calibration(&fit.photographs.dataset.train, fit.file.sphere(), freedom);
    if options.refine_cameras != RefineCameras::Auto {
        let (refined, _) = trial(fit, start, TRIAL_STEPS)?;
        fit.photographs.corrections = Corrections::Refined(refined);
        return Ok(None);
    }

    let iterations = fit.clock.iteration;
    let steps = (iterations / ITERATIONS_PER_STEP).min(TRIAL_STEPS);
    if fit.photographs.dataset.train.len() < 2 {
        return Ok(None);
    }
    if steps < LEAST_STEPS {
        let least = LEAST_STEPS * ITERATIONS_PER_STEP;
        return Ok(Some(CameraDecision::TooShort { iterations, least }));
    }
    let (refined, trial) = trial(fit, start, steps)?;
    if trial.is_kept {
        fit.photographs.corrections = Corrections::Refined(refined);
    }
    Ok(Some(CameraDecision::Trial(trial)))
}

/// Refines cameras for some steps, with the model as it is.
fn trial(
    fit: &Fit,
    mut refined: Calibration,
    steps: u64,
) -> Result<(Calibration, Trial), FitError> {
    let stream = Stream::of_seed(fit.file.options.seed).named(CAMERA_TRIAL);
    let draws = fit.file.options.batch as u64;
    let mut work = Workspace::default();
    for step in 0..steps {
        let draws = trial_pixels(fit, step * draws..(step + 1) * draws, stream.at(0));
        let pixel_count = draws.iter().map(|p| f32::from(p.count)).sum();
        let drawn = DrawnPixels { level: 0, draws, pixel_count };
        let (Gradient { cameras, parameters, .. }, _) =
            differentiate(fit, &drawn, Some(&refined), stream.at(1).at(step), &mut work)?;
        work.reuse(parameters);
        let rate = TRIAL_RATE * (1.0 - step as f64 / steps as f64);
        refined.step(&fit.photographs.levels[0].cameras, &cameras, rate)?;
    }

    let views = fit.photographs.dataset.train.len() as u64;
    let pixels = trial_pixels(fit, 0..TRIAL_PIXELS * views, stream.at(2));
    let given = residuals(fit, &pixels, None)?;
    let now = residuals(fit, &pixels, Some(&refined))?;
    let pairs = given.iter().zip(&now).filter_map(|(a, b)| Some((((*a)?), (*b)?)));
    let (given, now): (Vec<f64>, Vec<f64>) = pairs.unzip();
    let trial = Trial::of(&given, &now, &refined);
    Ok((refined, trial))
}

fn trial_pixels(fit: &Fit, draws: std::ops::Range<u64>, stream: Stream) -> Vec<Draw> {
    let every = background_group(1.0);
    draws.map(|i| fit.photographs.levels[0].draw(i, every, stream)).collect()
}

/// The mean residual of each view over these pixels of the photographs; `None` for a view without
/// one.
fn residuals(
    fit: &Fit,
    pixels: &[Draw],
    calibration: Option<&Calibration>,
) -> Result<Vec<Option<f64>>, InvalidField> {
    let photographs = &fit.photographs;
    let level = &photographs.levels[0];
    let cameras = corrected(calibration, &level.cameras);
    let scene = fit.scene(&cameras);
    let gains = photographs.factors();
    let divided = without_gains(photographs.colors.as_ref(), &gains);
    let colors = divided.as_ref().or(photographs.colors.as_ref());
    let background = colors.map_or(scene.background, |colors| colors);
    let scene = Scene { background, ..scene };

    let samples: Vec<Sample> = pixels.iter().map(Draw::center).collect();
    let gain = |p: &Draw| gains.get(p.view as usize).copied().unwrap_or(Vec3::ONE);
    let mut sums = vec![(0.0, 0.0); cameras.len()];
    for (pixels, samples) in pixels.chunks(TRACED_CHUNK).zip(samples.chunks(TRACED_CHUNK)) {
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
