//! The photometric term with a sharp surface: pixels without silhouettes through their hit points,
//! the others by the estimator.

use std::ops::Range;

use crate::photometry::{Pixel, TypicalLosses};
use estimate::record::Record;
use estimate::{SilhouetteMargin, SilhouetteMask, Terms, near_silhouettes};
use glam::{DVec2, Vec3};
use lanes::LANES;
use random::{Purpose, Stream};
use rayon::prelude::*;
use render::{InvalidField, Sample};

use crate::batch::{Batch, PixelLoss};
use crate::eikonal::NearPoint;
use crate::gradient::{in_order, share};
use crate::part::{OfPixels, Part, pixels_of};
use crate::sums::{Stage, Workspace};

/// Traces one sample for each pixel of the batch, then records those that a silhouette may cross,
/// and gives each part its pixels.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub(crate) fn trace<'a>(
    batch: &'a Batch<'a>,
    work: &Workspace,
    parts: &mut [Part<'a>],
) -> Result<(), InvalidField> {
    let (tasks, count) = (work.tasks(), batch.pixels.len());
    let traced = (0..tasks)
        .into_par_iter()
        .with_max_len(1)
        .map(|task| work.run(Stage::Trace, || batch.trace(share(count, task, tasks))));
    let mut all = in_order(traced)?.into_iter().fold(OfPixels::default(), OfPixels::joined);
    let losses = all.photometric();
    let hits = all.record.area.first().map(|area| area.primary.hit_mask()).unwrap_or_default();
    let typical = TypicalLosses::of(batch.pixels, &hits, &losses);
    let crossed = batch.pixels.iter().zip(&losses).filter(|(_, loss)| loss.is_none());
    let crossed: Vec<Pixel> = crossed.map(|(pixel, _)| *pixel).collect();
    // Records of a warp depend on the pixels beside: these are those of a part.
    let is_by_pixel = batch.estimator.is_by_pixel();
    let tasks = if is_by_pixel { tasks } else { parts.len() };
    let recorded = (0..tasks).into_par_iter().with_max_len(1).map(|task| {
        let own = &crossed[share(crossed.len(), task, tasks)];
        work.run(Stage::Record, || batch.record(own))
    });
    let edges = in_order(recorded)?;
    if is_by_pixel {
        all = edges.into_iter().fold(all, OfPixels::joined);
    } else {
        parts.iter_mut().zip(edges).for_each(|(part, edge)| part.edge = edge);
    }
    let mut first = 0;
    for (own, part) in deal(all, parts.len()).into_iter().zip(parts) {
        part.typical = typical;
        first += part.set_pixels(first, own);
    }
    Ok(())
}

/// Deals pixels to parts: about the same number of hits for each, in whole blocks of the networks.
fn deal(all: OfPixels, parts: usize) -> Vec<OfPixels> {
    let count = all.pixels.len();
    let mut hits = vec![0; count];
    all.hits().for_each(|(pixel, _)| hits[pixel] += 1);
    let blocks = hits.iter().sum::<usize>().div_ceil(LANES);
    let (mut places, mut before) = (vec![0], 0);
    for (pixel, own) in hits.into_iter().enumerate() {
        before += own;
        while places.len() < parts && before > places.len() * blocks / parts * LANES {
            places.push(pixel);
        }
    }
    if blocks == 0 {
        places = (0..parts).map(|part| share(count, part, parts).start).collect();
    }
    places.resize(parts, count);
    places.push(count);
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

    /// Traces one sample for each pixel of a range. Pixels that a silhouette may cross have no
    /// loss.
    fn trace(&self, range: Range<usize>) -> Result<OfPixels, InvalidField> {
        let samples: Vec<Sample> = range.clone().map(|pixel| self.sample(pixel)).collect();
        let primary = self.scene.primary(&samples)?;
        let crossed = near_silhouettes(&self.scene, &primary, SilhouetteMargin::LARGE);
        let pixels = self.pixels[range].to_vec();
        let shown = pixels.iter().zip(&primary.samples).zip(crossed);
        let losses = shown
            .map(|((pixel, traced), crossed)| (!crossed).then(|| self.loss(traced.radiance, pixel)))
            .collect();
        Ok(OfPixels { record: Record::uniform(primary, 1), pixels, losses })
    }

    /// Samples pixels that a silhouette may cross.
    fn record(&self, pixels: &[Pixel]) -> Result<OfPixels, InvalidField> {
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
        let losses = shown.map(|(pixel, radiance)| Some(self.loss(*radiance, pixel))).collect();
        Ok(OfPixels { record, pixels: pixels.to_vec(), losses })
    }
}

impl Part<'_> {
    /// Adds the photometric and the eikonal term of the pixels of this part.
    pub(crate) fn add_sharp_pixels(&mut self) {
        let (own, edge) = (std::mem::take(&mut self.own), std::mem::take(&mut self.edge));
        let smooth = self.pixels.len();
        self.stats.pixels += pixels_of(self.pixels);
        let near = own.hits().filter(|(pixel, _)| *pixel < smooth);
        let near = near.map(|(pixel, x)| NearPoint {
            pixel,
            x,
            weight: f32::from(self.pixels[pixel].count),
        });
        let near: Vec<NearPoint> = near.collect();
        self.add_eikonal(&near);
        self.add_bending(&near);
        self.add_pixels(own, smooth);
        self.add_pixels(edge, 0);
    }

    /// Adds the losses of pixels, and the gradient of their record. A silhouette may cross the
    /// pixels from the number `smooth` on.
    fn add_pixels(&mut self, own: OfPixels, smooth: usize) {
        let OfPixels { record, pixels, losses } = own;
        self.stats.edge_pixels += pixels_of(&pixels[smooth..]);
        self.stats.rays += record.rays;
        let losses = || pixels.iter().zip(&losses);
        let delta: Vec<Vec3> = losses()
            .map(|(p, loss)| loss.as_ref().map_or(Vec3::ZERO, |loss| self.add_loss(loss, p)))
            .collect();
        if let Some(typical) = self.typical {
            let slope =
                |((i, (p, loss)), coverage): ((usize, (&Pixel, &Option<PixelLoss>)), f32)| {
                    let loss = loss.as_ref().filter(|_| i >= smooth);
                    let weight = self.share * f32::from(p.count);
                    loss.map_or(0.0, |loss| typical.slope(coverage, loss.loss) * weight)
                };
            let slopes = losses().enumerate().zip(record.coverage()).map(slope);
            record.coverage_vjp(&slopes.collect::<Vec<f32>>(), &mut self.adjoints);
        }
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
