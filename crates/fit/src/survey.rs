//! Surveys of the surface: once it is sharp, few of the pixels far from it are drawn, and nodes of
//! fine levels of the field's grid are free near it only.

use std::path::Path;

use field::Field;
use files::InputError;
use glam::{DVec3, Vec3};
use loss::schedule::surveys;
use rayon::prelude::*;
use render::{InvalidField, Sample};
use sdf_nn::Transform;

use crate::cameras::corrected;
use crate::checkpoint::Survey;
use crate::error::FitError;
use crate::fit::{Fit, TRACED_CHUNK};
use crate::model::Model;

/// The finest level of the pyramid whose pixels are traced, if there is one: a quarter of the rays.
const TRACED_LEVEL: usize = 1;

/// The most pixels that are traced, for each iteration of the budget: a survey takes a hundredth or
/// two of the fit's time. Larger photographs are traced on a coarser level.
const TRACED_PER_ITERATION: u64 = 100;

/// The margin around a pixel without a surface, in pixels of the traced level.
const MARGIN: u32 = 2;

/// The largest |f| at a free node, in units of the reach of its splines along an axis. Splines that
/// reach the surface along a diagonal count, and there is room for the surface to move.
const NEAR: f64 = 1.5;

/// Surveys the surface, if it is time. The bits do not depend on the number of threads.
pub(crate) fn survey_surface(fit: &mut Fit) -> Result<(), FitError> {
    let number = surveys(fit.progress(), fit.file.options.soft());
    let done = fit.survey.as_ref().map_or(0, |survey| survey.number);
    if number <= done {
        return Ok(());
    }
    let trained = fit.file.background_kind.is_trained();
    let is_far = if trained { far_pixels(fit)? } else { Vec::new() };
    let fine = fit.model.fine_levels();
    let is_free = fine.map(|level| near_nodes(&fit.model, level)).collect::<Vec<_>>().concat();
    fit.optimiser.free_nodes(&mut fit.model, &is_free)?;
    set_survey(fit, Survey { number, is_far, is_free });
    Ok(())
}

/// Whether each pixel of the traced level is far from the surface.
///
/// In front of a uniform background, photographs tell which pixels show it. In front of a trained
/// one, nothing but the surface does.
fn far_pixels(fit: &Fit) -> Result<Vec<bool>, InvalidField> {
    let photographs = &fit.photographs;
    let level = &photographs.levels[traced_level(fit)];
    let cameras = corrected(photographs.corrections.get(), &level.cameras);
    let scene = fit.scene(&cameras);
    let misses = |samples: &[Sample]| {
        let rays = scene.trace(samples)?;
        Ok(rays.iter().map(|ray| ray.and_then(|ray| ray.depth()).is_none()).collect())
    };
    let mut all = Vec::with_capacity(level.photograph_pixels() as usize);
    for view in 0..cameras.len() {
        let samples = level.centers_of(view);
        let parts = samples.par_chunks(TRACED_CHUNK).map(misses);
        all.extend(parts.collect::<Result<Vec<Vec<bool>>, InvalidField>>()?.concat());
    }
    Ok(level.with_margin(&all, MARGIN))
}

/// Whether the splines of each node of a level meet the surface, or nearly do.
fn near_nodes(model: &Model, level: usize) -> Vec<bool> {
    let field = &model.field;
    let Transform { center, radius } = *field.transform();
    // In the unit ball.
    let values = |nodes: &[[f64; 3]]| {
        let place = |y: &[f64; 3]| (DVec3::from(*y) * radius + center).as_vec3();
        let points: Vec<Vec3> = nodes.iter().map(place).collect();
        let mut f = vec![0.0; points.len()];
        field.value(&points, &mut f);
        f.into_iter().map(|f| f64::from(f) / radius).collect()
    };
    let splines = field.splines();
    splines.nodes_near(level, NEAR * splines.reach(level), values)
}

/// The level of the pyramid whose pixels are traced.
fn traced_level(fit: &Fit) -> usize {
    let most = fit.file.options.assumed_shared_iterations().saturating_mul(TRACED_PER_ITERATION);
    let levels = &fit.photographs.levels;
    let last = levels.len() - 1;
    let fits = |level: &usize| levels[*level].photograph_pixels() <= most;
    (TRACED_LEVEL.min(last)..last).find(fits).unwrap_or(last)
}

/// The level of the pyramid that has this number of pixels.
fn level_of(fit: &Fit, pixels: usize) -> Option<usize> {
    let levels = &fit.photographs.levels;
    levels.iter().position(|level| level.photograph_pixels() as usize == pixels)
}

/// Restores the survey of a checkpoint. A longer budget can put the run back to before a survey:
/// then it is made again when it is time.
pub(crate) fn restore_survey(
    fit: &mut Fit,
    state: Option<Survey>,
    checkpoint: &Path,
) -> Result<(), FitError> {
    let Some(Survey { number, is_far, is_free }) = state else { return Ok(()) };
    let check = |name: &str, found: usize, expected: usize| {
        if found == expected {
            return Ok(());
        }
        let expected = format!("{expected}, according to fit.toml");
        Err(InputError::new(checkpoint, name, found, expected))
    };
    // Another budget can trace another level: that of the file counts until the next survey.
    let trained = fit.file.background_kind.is_trained();
    let level = level_of(fit, is_far.len()).unwrap_or_else(|| traced_level(fit));
    let pixels = fit.photographs.levels[level].photograph_pixels() as usize;
    check("is_far", is_far.len(), if trained { pixels } else { 0 })?;
    check("is_free", is_free.len(), fit.model.fine_nodes())?;

    let due = surveys(fit.progress(), fit.file.options.soft());
    fit.optimiser.free_nodes(&mut fit.model, &is_free)?;
    set_survey(fit, Survey { number: number.min(due), is_far, is_free });
    Ok(())
}

fn set_survey(fit: &mut Fit, survey: Survey) {
    let level = level_of(fit, survey.is_far.len()).filter(|_| survey.number > 0);
    if let Some(level) = level {
        fit.photographs.levels[0].group(&survey.is_far, 1 << level);
    }
    fit.survey = Some(survey);
    // Coefficients of nodes that are not free any more are zero from now on.
    fit.lattice = None;
}
