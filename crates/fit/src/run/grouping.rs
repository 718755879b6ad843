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
        let grouping = Grouping { number: due, is_far: level.with_margin(&all, MARGIN) };
        self.set_grouping(Some(grouping));
        Ok(())
    }

    /// The level of the pyramid whose pixels are traced.
    fn traced_level(&self) -> usize {
        TRACED_LEVEL.min(self.levels.len() - 1)
    }

    /// Restores the grouping of a checkpoint. A longer budget can put the run back to before the
    /// grouping: then it is forgotten, and pixels are grouped again when it is time.
    pub(super) fn restore_grouping(&mut self, state: Option<Grouping>) -> Result<(), InputError> {
        let Some(Grouping { number, is_far }) = state else { return Ok(()) };
        let wrong = |found: String, expected: String| {
            Err(InputError::new(checkpoint_path(&self.folder), "grouping", found, expected))
        };
        if !self.file.background_kind.is_trained() {
            return wrong("a grouping".to_owned(), "none, by background_kind of fit.toml".into());
        }
        let count = self.levels[self.traced_level()].photograph_pixels();
        if is_far.len() as u64 != count {
            return wrong(format!("{} pixels", is_far.len()), count.to_string());
        }
        let due = schedule::groupings(self.progress(), self.file.options.soft);
        let number = number.min(due);
        self.set_grouping((number > 0).then_some(Grouping { number, is_far }));
        Ok(())
    }

    fn set_grouping(&mut self, grouping: Option<Grouping>) {
        if let Some(Grouping { is_far, .. }) = &grouping {
            let factor = 1 << self.traced_level();
            self.levels[0].group(is_far, factor);
        }
        self.grouping = grouping;
    }
}
