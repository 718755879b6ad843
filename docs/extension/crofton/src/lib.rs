#![doc = include_str!("../README.md")]

mod chord;
mod silhouette;

use estimate::record::Record;
use estimate::{Batch, Estimator, SilhouetteMargin, SilhouetteMask, Terms, near_silhouettes};
use field::Real;
use render::{InvalidField, Scene, pixel_samples};

/// Silhouettes, found by bisection along random lines of the film and weighted by Crofton's
/// formula.
///
/// Area samples give the smooth part. In each pixel that a silhouette may cross, the number of
/// lines is `edge_samples` of the batch.
#[derive(Clone, Copy, Debug)]
pub struct Crofton;

impl<R: Real> Estimator<R> for Crofton {
    fn differentiates_cameras(&self) -> bool {
        true
    }

    fn record(
        &self,
        scene: &Scene<'_, R>,
        batch: &Batch<'_>,
        mask: &mut SilhouetteMask,
    ) -> Result<Record<R>, InvalidField> {
        let spp = batch.counts.spp;
        let samples = pixel_samples(batch.pixels.iter().copied(), &(0..spp), batch.stream);
        let primary = scene.primary(&samples)?;
        let near = near_silhouettes(scene, &primary, SilhouetteMargin::LARGE);
        let hit = primary.hit_mask();
        mask.may_cross.resize(batch.pixels.len(), false);
        for (i, marked) in mask.may_cross.iter_mut().enumerate() {
            let own = i * spp as usize..(i + 1) * spp as usize;
            let hits = hit[own.clone()].iter().filter(|hit| **hit).count();
            *marked |= near[own].contains(&true) || (hits > 0 && hits < spp as usize);
        }
        let mut record = Record::uniform(primary, spp);
        if batch.terms == Terms::Silhouettes {
            record.area.clear();
        }
        silhouette::add_silhouettes(scene, batch, mask, &mut record)?;
        Ok(record)
    }
}

#[cfg(test)]
mod tests;
