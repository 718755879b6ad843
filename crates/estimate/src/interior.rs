//! The estimator `interior`, without a silhouette term.

use field::Real;
use render::{InvalidField, Scene, pixel_samples};

use crate::discontinuity::Discontinuity;
use crate::estimator::{Batch, Estimator, SilhouetteMask};
use crate::record::Record;

/// Backpropagation through the hit points. It is biased: it has no silhouette term.
#[derive(Clone, Copy, Debug)]
pub struct Interior;

impl<R: Real> Estimator<R> for Interior {
    fn record(
        &self,
        scene: &Scene<'_, R>,
        batch: &Batch<'_>,
        _: &mut SilhouetteMask,
    ) -> Result<Record<R>, InvalidField> {
        let spp = batch.counts.spp;
        let samples = pixel_samples(batch.pixels.iter().copied(), &(0..spp), batch.stream);
        let primary = scene.primary(&samples)?;
        Ok(Record::uniform(primary, spp))
    }

    fn unmodelled(&self, scene: &Scene<'_, R>) -> Vec<Discontinuity> {
        Discontinuity::of_scene_except(scene, &[])
    }
}
