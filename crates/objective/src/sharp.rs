//! The photometric term with a sharp surface: pixels without silhouettes through their hit points,
//! the others by the estimator.

use std::ops::Range;

use estimate::record::Record;
use estimate::{SilhouetteMargin, SilhouetteMask, Terms, near_silhouettes};
use glam::{DVec2, Vec3};
use photometry::{Pixel, TypicalLosses};
use random::{Purpose, Stream};
use rayon::prelude::*;
use render::{InvalidField, Sample};

use crate::batch::{Batch, PixelLoss};
use crate::gradient::in_order;
use crate::part::{OfPixels, Part, pixels_of};
use crate::sums::{Stage, Workspace};

/// Traces one sample for each pixel of the batch, and gives each part its pixels: about the same
/// number of hits, and of pixels that a silhouette may cross.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub(crate) fn trace<'a>(
    batch: &'a Batch<'a>,
    work: &Workspace,
    parts: &mut [Part<'a>],
) -> Result<(), InvalidField> {
    let tasks = work.tasks();
    let traced = (0..tasks).into_par_iter().with_max_len(1).map(|task| {
        let own = share(batch.pixels.len(), task, tasks);
        work.run(Stage::Trace, || batch.trace(own))
    });
    let mut all = OfPixels { pixels: batch.pixels.to_vec(), ..OfPixels::default() };
    for (record, losses) in in_order(traced)? {
        all.record.append(record);
        all.losses.extend(losses);
    }
    let losses: Vec<Option<f32>> = all.losses.iter().map(|l| l.as_ref().map(|l| l.loss)).collect();
    let hits = all.record.area.first().map(|area| area.primary.hit_mask()).unwrap_or_default();
    let typical = TypicalLosses::of(batch.pixels, &hits, &losses);
    let crossed = batch.pixels.iter().zip(&losses).filter(|(_, loss)| loss.is_none());
    let crossed: Vec<Pixel> = crossed.map(|(pixel, _)| *pixel).collect();
    let (mut first, count) = (0, parts.len());
    for (number, (own, part)) in deal(all, count).into_iter().zip(parts).enumerate() {
        let next = first + own.pixels.len();
        part.typical = typical;
        part.edge.pixels = crossed[share(crossed.len(), number, count)].to_vec();
        part.set_smooth(first, own);
        first = next;
    }
    Ok(())
}

/// Samples the pixels of some parts that a silhouette may cross, together if the estimator can.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub(crate) fn record_edges(batch: &Batch<'_>, parts: &mut [Part<'_>]) -> Result<(), InvalidField> {
    // Records of a warp depend on the pixels beside: these are those of a part.
    let together = if batch.estimator.is_by_pixel() { parts.len() } else { 1 };
    for parts in parts.chunks_mut(together) {
        let pixels: Vec<Pixel> =
            parts.iter().flat_map(|part| part.edge.pixels.iter().copied()).collect();
        let (record, losses) = batch.record(&pixels)?;
        let sizes: Vec<usize> = parts.iter().map(|part| part.edge.pixels.len()).collect();
        let records = if parts.len() == 1 { vec![record] } else { record.deal(&sizes) };
        let mut losses = losses.into_iter().map(Some);
        for (part, record) in parts.iter_mut().zip(records) {
            part.edge.losses = losses.by_ref().take(part.edge.pixels.len()).collect();
            part.edge.record = record;
        }
    }
    Ok(())
}

/// The share of a task in `count` things.
fn share(count: usize, task: usize, tasks: usize) -> Range<usize> {
    task * count / tasks..(task + 1) * count / tasks
}

/// Deals pixels to parts with about the same number of hits: a pixel without a hit costs nothing in
/// reverse mode.
fn deal(all: OfPixels, parts: usize) -> Vec<OfPixels> {
    let mut hits = vec![0; all.pixels.len()];
    for area in &all.record.area {
        area.primary.hits.iter().for_each(|hit| hits[area.shares[hit.sample].pixel as usize] += 1);
    }
    let total: usize = hits.iter().sum();
    let (mut places, mut before) = (vec![0], 0);
    for (pixel, own) in hits.into_iter().enumerate() {
        before += own;
        while places.len() < parts && before * parts >= places.len() * total.max(1) {
            places.push(pixel + 1);
        }
    }
    places.resize(parts, all.pixels.len());
    places.push(all.pixels.len());
    let sizes: Vec<usize> = places.windows(2).map(|place| place[1] - place[0]).collect();
    let (mut pixels, mut losses) = (all.pixels.into_iter(), all.losses.into_iter());
    let own = |(record, size): (Record<f32>, &usize)| OfPixels {
        record,
        pixels: pixels.by_ref().take(*size).collect(),
        losses: losses.by_ref().take(*size).collect(),
    };
    all.record.deal(&sizes).into_iter().zip(&sizes).map(own).collect()
}

impl Batch<'_> {
    /// A uniform random sample in a pixel of the batch.
    pub(crate) fn sample(&self, pixel: usize) -> Sample {
        let stream = Stream::new(self.seed, Purpose::FitSamples).at(pixel as u64);
        let p = &self.pixels[pixel];
        let u =
            DVec2::new(f64::from(p.x) + stream.at(0).unit(), f64::from(p.y) + stream.at(1).unit());
        Sample { camera: p.view as usize, u }
    }

    /// Traces one sample for each pixel of a range. Returns also the losses of the pixels that no
    /// silhouette crosses.
    fn trace(
        &self,
        range: Range<usize>,
    ) -> Result<(Record<f32>, Vec<Option<PixelLoss>>), InvalidField> {
        let samples: Vec<Sample> = range.clone().map(|pixel| self.sample(pixel)).collect();
        let primary = self.scene.primary(&samples)?;
        let crossed = near_silhouettes(&self.scene, &primary, SilhouetteMargin::LARGE);
        let pixels = self.pixels[range].iter().zip(&primary.samples).zip(crossed);
        let losses = pixels
            .map(|((pixel, traced), crossed)| (!crossed).then(|| self.loss(traced.radiance, pixel)))
            .collect();
        Ok((Record::uniform(primary, 1), losses))
    }

    /// The record of pixels that a silhouette may cross, and their losses.
    fn record(&self, pixels: &[Pixel]) -> Result<(Record<f32>, Vec<PixelLoss>), InvalidField> {
        let positions: Vec<render::Pixel> = pixels
            .iter()
            .map(|p| render::Pixel { camera: p.view as usize, x: p.x.into(), y: p.y.into() })
            .collect();
        let batch = estimate::Batch {
            pixels: &positions,
            counts: self.counts,
            seed: Stream::new(self.seed, Purpose::FitSilhouettes).bits(),
            terms: Terms::All,
        };
        let mut mask = SilhouetteMask::all(positions.len());
        let record = self.estimator.record(&self.scene, &batch, &mut mask)?;
        let shown = pixels.iter().zip(&record.radiance);
        let losses = shown.map(|(pixel, radiance)| self.loss(*radiance, pixel)).collect();
        Ok((record, losses))
    }
}

impl Part<'_> {
    /// Adds the photometric and the eikonal term of the pixels of this part.
    pub(crate) fn add_sharp_pixels(&mut self) {
        let (smooth, edge) = (std::mem::take(&mut self.smooth), std::mem::take(&mut self.edge));
        self.stats.pixels += pixels_of(&smooth.pixels);
        self.stats.edge_pixels += pixels_of(&edge.pixels);
        self.add_eikonal(&smooth.hit_points());
        self.add_coverage(&edge);
        if edge.record.has_cameras() {
            self.add_pixels(smooth.joined(edge));
        } else {
            self.add_pixels(smooth);
            self.add_pixels(edge);
        }
    }

    /// Adds the term of the coverage of pixels that a silhouette may cross.
    fn add_coverage(&mut self, edge: &OfPixels) {
        let Some(typical) = self.typical else { return };
        let slope = |((p, loss), coverage): ((&Pixel, &Option<PixelLoss>), f32)| {
            loss.as_ref().map_or(0.0, |loss| {
                typical.slope(coverage, loss.loss) * self.share * f32::from(p.count)
            })
        };
        let pixels = edge.pixels.iter().zip(&edge.losses).zip(edge.record.coverage());
        edge.record.coverage_vjp(&pixels.map(slope).collect::<Vec<f32>>(), &mut self.adjoints);
    }

    /// Adds the losses of pixels, and the gradient of their record.
    fn add_pixels(&mut self, own: OfPixels) {
        let OfPixels { record, pixels, losses } = own;
        let zero = Vec3::ZERO;
        let delta: Vec<Vec3> = pixels
            .iter()
            .zip(&losses)
            .map(|(p, loss)| loss.as_ref().map_or(zero, |loss| self.add_loss(loss, p)))
            .collect();
        self.stats.rays += record.rays;
        if let Some(cameras) = &mut self.adjoints.cameras {
            cameras.continue_with(pixels.iter().map(|p| p.view as usize).collect());
        }
        let Batch { scene, pass, trains_background, .. } = self.batch;
        record.vjp(scene, &delta, *pass, &mut self.sums.shader, &mut self.adjoints);
        if *trains_background {
            let sum = &mut self.sums.background;
            record.area.iter().for_each(|area| area.background_vjp(scene, &delta, sum));
        }
    }
}
