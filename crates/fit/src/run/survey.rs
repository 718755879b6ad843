//! Surveys of the surface: once it is sharp, few of the pixels far from it are drawn, and nodes of
//! fine levels of the field's grid are free near it only.

use crate::checkpoint::Survey;
use field::Field;
use files::InputError;
use glam::DVec3;
use optim::Adam;
use rayon::prelude::*;
use render::{InvalidField, Sample};
use sdf_nn::Transform;

use super::checkpoints::checkpoint_path;
use super::{Fit, TRACED_CHUNK, scene};
use crate::cameras::corrected;

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

impl Fit {
    /// Surveys the surface, if it is time. The bits do not depend on the number of threads.
    pub(super) fn survey_surface(&mut self) -> anyhow::Result<()> {
        let number = loss::schedule::surveys(self.progress(), self.file.options.soft());
        let done = self.survey.as_ref().map_or(0, |survey| survey.number);
        if number <= done {
            return Ok(());
        }
        let trained = self.file.background_kind.is_trained();
        let is_far = if trained { self.far_pixels()? } else { Vec::new() };
        let fine = self.model.fine_levels();
        let is_free = fine.map(|level| self.near_nodes(level)).collect::<Vec<_>>().concat();
        self.free_nodes(&is_free)?;
        self.set_survey(Survey { number, is_far, is_free });
        Ok(())
    }

    /// Whether each pixel of the traced level is far from the surface.
    ///
    /// Before a uniform background, photographs tell which pixels show it. Before a trained one,
    /// nothing but the surface does.
    fn far_pixels(&self) -> Result<Vec<bool>, InvalidField> {
        let level = &self.levels[self.traced_level()];
        let cameras = corrected(self.corrections.calibration(), &level.cameras);
        let scene = scene(&self.model, &self.file, &cameras);
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
    fn near_nodes(&self, level: usize) -> Vec<bool> {
        let field = &self.model.field;
        let Transform { center, radius } = *field.transform();
        // In the unit ball.
        let values = |nodes: &[[f64; 3]]| {
            let place = |y: &[f64; 3]| (DVec3::from(*y) * radius + center).as_vec3();
            let points: Vec<glam::Vec3> = nodes.iter().map(place).collect();
            let mut f = vec![0.0; points.len()];
            field.value(&points, &mut f);
            f.into_iter().map(|f| f64::from(f) / radius).collect()
        };
        let splines = field.splines();
        splines.nodes_near(level, NEAR * splines.reach(level), values)
    }

    /// Frees these nodes of the fine levels, and no others. Coefficients and moments of nodes that
    /// stay free are kept.
    fn free_nodes(&mut self, is_free: &[bool]) -> anyhow::Result<()> {
        if is_free.is_empty() {
            return Ok(());
        }
        let before = self.model.field.splines().clone();
        let weights = self.model.field.weight_count();
        let old = weights + before.free_count();
        self.model.set_fine_nodes(is_free);
        let after = self.model.field.splines();
        let moved = |all: &[f32]| {
            let mut table = after.table();
            before.expand(&all[weights..old], &mut table);
            [&all[..weights], &after.gather(&table), &all[old..]].concat()
        };
        let (first, second, steps) = self.adam.state();
        let (first, second) = (moved(first), moved(second));
        self.parameters = self.model.parameters();
        self.adam = Adam::new(self.parameters.len(), self.model.groups());
        self.adam.restore(&first, &second, steps)?;
        self.average = None;
        Ok(())
    }

    /// The level of the pyramid whose pixels are traced.
    fn traced_level(&self) -> usize {
        let most = self.file.options.assumed_iterations().saturating_mul(TRACED_PER_ITERATION);
        let last = self.levels.len() - 1;
        let fits = |level: &usize| self.levels[*level].photograph_pixels() <= most;
        (TRACED_LEVEL.min(last)..last).find(fits).unwrap_or(last)
    }

    /// The level of the pyramid that has this number of pixels.
    fn level_of(&self, pixels: usize) -> Option<usize> {
        self.levels.iter().position(|level| level.photograph_pixels() as usize == pixels)
    }

    /// Restores the survey of a checkpoint. A longer budget can put the run back to before a
    /// survey: then it is made again when it is time.
    pub(super) fn restore_survey(&mut self, state: Option<Survey>) -> anyhow::Result<()> {
        let Some(Survey { number, is_far, is_free }) = state else { return Ok(()) };
        let check = |name: &str, found: usize, expected: usize| {
            if found == expected {
                return Ok(());
            }
            let expected = format!("{expected}, according to fit.toml");
            Err(InputError::new(checkpoint_path(&self.folder), name, found, expected))
        };
        // Another budget can trace another level: that of the file counts until the next survey.
        let trained = self.file.background_kind.is_trained();
        let level = self.level_of(is_far.len()).unwrap_or_else(|| self.traced_level());
        let pixels = self.levels[level].photograph_pixels() as usize;
        check("is_far", is_far.len(), if trained { pixels } else { 0 })?;
        check("is_free", is_free.len(), self.model.fine_nodes())?;
        let due = loss::schedule::surveys(self.progress(), self.file.options.soft());
        self.free_nodes(&is_free)?;
        self.set_survey(Survey { number: number.min(due), is_far, is_free });
        Ok(())
    }

    fn set_survey(&mut self, survey: Survey) {
        let level = self.level_of(survey.is_far.len()).filter(|_| survey.number > 0);
        if let Some(level) = level {
            self.levels[0].group(&survey.is_far, 1 << level);
        }
        self.survey = Some(survey);
    }
}
