//! The photometric term: pixels without silhouettes through their hit points, the others by the
//! estimator.

use estimate::record::{Area, Share};
use estimate::{SilhouetteMask, Terms};
use glam::Vec3;
use random::{Purpose, Stream};
use render::{InvalidField, Primary};

use super::chunk::{Chunk, pixels_of};
use photometry::{Pixel, TypicalLosses};

impl Chunk<'_> {
    /// Adds the pixels that no silhouette crosses, through their hit points. `crossed` flags the
    /// others. Returns the typical losses, if they tell the object from the background.
    pub(super) fn add_smooth_pixels(
        &mut self,
        primary: Primary<f32>,
        crossed: &[bool],
        shader: &mut [f32],
        background: &mut [f32],
    ) -> Option<TypicalLosses> {
        let n = primary.samples.len();
        let (mut delta, mut losses) = (vec![Vec3::ZERO; n], vec![None; n]);
        for (i, pixel) in self.pixels.iter().enumerate().filter(|(i, _)| !crossed[*i]) {
            let (adjoint, loss) = self.add_loss(primary.samples[i].radiance.into(), *pixel);
            (delta[i], losses[i]) = (adjoint, Some(loss));
        }
        let hits = primary.hits.iter().map(|hit| hit.sample).zip(primary.surface.x.iter().copied());
        let typical = TypicalLosses::of(self.pixels, &primary.hit_mask(), &losses);
        self.carve(hits.filter(|(i, _)| !crossed[*i]), &losses);
        let shares = (0..n as u32).map(|pixel| Share { pixel, weight: 1.0 }).collect();
        let area = Area { primary, shares, warp: None };
        area.vjp(&self.batch.scene, &delta, self.batch.pass, shader, &mut self.adjoints);
        if self.batch.trains_background {
            area.background_vjp(&self.batch.scene, &delta, background);
        }
        typical
    }

    /// Adds the pixels that a silhouette may cross, with the typical losses of the others.
    pub(super) fn add_silhouette_pixels(
        &mut self,
        pixels: &[Pixel],
        typical: Option<TypicalLosses>,
        shader: &mut [f32],
        background: &mut [f32],
    ) -> Result<(), InvalidField> {
        let scene = &self.batch.scene;
        self.stats.edge_pixels += pixels_of(pixels);
        let positions: Vec<render::Pixel> = pixels
            .iter()
            .map(|p| render::Pixel { camera: p.view as usize, x: p.x.into(), y: p.y.into() })
            .collect();
        let batch = estimate::Batch {
            pixels: &positions,
            counts: self.batch.counts,
            seed: Stream::new(self.seed, Purpose::FitSilhouettes).bits(),
            terms: Terms::All,
        };
        let mut mask = SilhouetteMask::all(positions.len());
        let record = self.batch.estimator.record(scene, &batch, &mut mask)?;
        self.stats.rays += record.rays;
        let (delta, losses): (Vec<Vec3>, Vec<f32>) = pixels
            .iter()
            .zip(&record.radiance)
            .map(|(p, radiance)| self.add_loss((*radiance).into(), *p))
            .unzip();
        if let Some(typical) = typical {
            let slope = |((p, loss), coverage): ((&Pixel, &f32), f32)| {
                typical.slope(coverage, *loss) * self.share * f32::from(p.count)
            };
            let pixels = pixels.iter().zip(&losses).zip(record.coverage());
            record.coverage_vjp(&pixels.map(slope).collect::<Vec<f32>>(), &mut self.adjoints);
        }
        if let Some(cameras) = &mut self.adjoints.cameras {
            // The pixels of the record are a part of the chunk's.
            cameras.continue_with(pixels.iter().map(|p| p.view as usize).collect());
        }
        record.vjp(scene, &delta, self.batch.pass, shader, &mut self.adjoints);
        if self.batch.trains_background {
            record.area.iter().for_each(|area| area.background_vjp(scene, &delta, background));
        }
        Ok(())
    }
}
