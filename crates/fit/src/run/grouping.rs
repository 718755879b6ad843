//! Pixels far from the surface, of which few are drawn once the surface is sharp.

use checkpoint::Grouping;
use io::InputError;
use rayon::prelude::*;
use render::{InvalidField, Sample};

use super::{Fit, TRACED_CHUNK, checkpoint_path, scene};
use crate::cameras::corrected;

/// The level of the pyramid whose pixels are traced, if there is one: a quarter of the rays.
const TRACED_LEVEL: usize = 1;

/// The margin around a pixel without a surface, in pixels of the traced level.
const MARGIN: u32 = 2;

impl Fit {
    /// Groups the pixels by the surface, if it is time. The bits do not depend on the number of
    /// threads.
    ///
    /// Before a uniform background, photographs tell which pixels show it. Before a trained one,
    /// nothing but the surface does.
    pub(super) fn group_pixels(&mut self) -> Result<(), InvalidField> {
        let due = schedule::groupings(self.progress(), self.file.options.soft);
        let done = self.grouping.as_ref().map_or(0, |grouping| grouping.number);
        if !self.file.background_kind.is_trained() || due <= done {
            return Ok(());
        }
        let level = &self.levels[self.traced_level()];
        let cameras = corrected(self.corrections.calibration(), &level.cameras);
        let scene = scene(&self.model, &self.file, &cameras);
        let samples: Vec<Sample> = level.all_centers().collect();
        let misses = |samples: &[Sample]| {
            let rays = scene.trace(samples)?;
            Ok(rays.iter().map(|ray| ray.and_then(|ray| ray.depth()).is_none()).collect())
        };
        let parts = samples.par_chunks(TRACED_CHUNK).map(misses);
        let misses = parts.collect::<Result<Vec<Vec<bool>>, InvalidField>>()?.concat();
        let grouping = Grouping { number: due, is_far: level.with_margin(&misses, MARGIN) };
        self.set_grouping(Some(grouping));
        Ok(())
    }

    /// The level of the pyramid whose pixels are traced.
    fn traced_level(&self) -> usize {
        TRACED_LEVEL.min(self.levels.len() - 1)
    }

    /// Restores the grouping of a checkpoint.
    pub(super) fn restore_grouping(&mut self, state: Option<Grouping>) -> Result<(), InputError> {
        let count = self.levels[self.traced_level()].photograph_pixels();
        match state.as_ref().map(|grouping| grouping.is_far.len() as u64) {
            Some(found) if found != count => {
                let (path, expected) = (checkpoint_path(&self.folder), format!("{count}"));
                Err(InputError::new(path, "grouping", format!("{found} pixels"), expected))
            }
            _ => {
                self.set_grouping(state);
                Ok(())
            }
        }
    }

    fn set_grouping(&mut self, grouping: Option<Grouping>) {
        if let Some(Grouping { is_far, .. }) = &grouping {
            let factor = 1 << self.traced_level();
            self.levels[0].group(is_far, factor);
        }
        self.grouping = grouping;
    }
}
