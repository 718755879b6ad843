//! A part of the batch of an iteration, with its coefficients and sums.

use crate::photometry::{Pixel, TypicalLosses};
use estimate::record::{Adjoints, CameraAdjoints, Record};
use glam::{DVec3, Vec3};
use random::{Purpose, Stream};
use render::Sample;

use crate::batch::{Batch, BatchStats, PixelLoss};
use crate::gradient::{PARTS, share};
use crate::sums::PartSums;

/// The number of pixels that these draws stand for.
pub(crate) fn pixels_of(draws: &[Pixel]) -> u64 {
    draws.iter().map(|p| u64::from(p.count)).sum()
}

/// Pixels with their record and losses.
#[derive(Default)]
pub(crate) struct OfPixels {
    pub(crate) record: Record<f32>,
    pub(crate) pixels: Vec<Pixel>,
    /// `None` for a pixel without a part in the loss.
    pub(crate) losses: Vec<Option<PixelLoss>>,
}

impl OfPixels {
    /// These pixels, and the others after them.
    ///
    /// # Panics
    /// If a record has a border or a warp.
    pub(crate) fn joined(mut self, other: Self) -> Self {
        self.record.append(other.record);
        self.pixels.extend(other.pixels);
        self.losses.extend(other.losses);
        self
    }

    /// The photometric loss of each pixel.
    pub(crate) fn photometric(&self) -> Vec<Option<f32>> {
        self.losses.iter().map(|loss| loss.map(|loss| loss.loss)).collect()
    }

    /// The hits, each with the number of its pixel.
    pub(crate) fn hits(&self) -> impl Iterator<Item = (usize, Vec3)> {
        self.record.area.iter().flat_map(|area| {
            let pixel = |sample: usize| area.weights[sample].pixel as usize;
            let hits = area.primary.hits.iter().zip(&area.primary.surface.x);
            hits.map(move |(hit, x)| (pixel(hit.sample), *x))
        })
    }
}

/// A part of a batch, with the coefficients and sums of the terms so far.
pub(crate) struct Part<'a> {
    pub(crate) batch: &'a Batch<'a>,
    /// The number of its first pixel in the batch.
    pub(crate) first: usize,
    pub(crate) pixels: &'a [Pixel],
    pub(crate) seed: u64,
    /// 1 over the expected number of pixels that the batch stands for.
    pub(crate) share: f32,
    pub(crate) adjoints: Adjoints<f32>,
    pub(crate) sums: PartSums,
    /// The adjoints of the natural logarithms of the gains.
    pub(crate) gains: Vec<DVec3>,
    pub(crate) stats: BatchStats,
    /// The loss of each pixel; `None` for one that a silhouette may cross.
    pub(crate) losses: Vec<Option<f32>>,
    /// Points of the surface that can be carved, each with the number of its pixel in the part.
    pub(crate) surface: Vec<(usize, Vec3)>,
    /// With a sharp surface: one sample for each of `pixels`, then records of pixels that a
    /// silhouette may cross. The latter need not be of `pixels`.
    pub(crate) own: OfPixels,
    /// The latter, if their records depend on the pixels beside.
    pub(crate) edge: OfPixels,
    /// The losses of the object and the background, if they tell them apart.
    pub(crate) typical: Option<TypicalLosses>,
}

impl<'a> Part<'a> {
    /// Part `number` of the batch, without terms; `sums` are zero.
    pub(crate) fn new(batch: &'a Batch<'a>, number: usize, sums: PartSums) -> Self {
        let place = share(batch.pixels.len(), number, PARTS);
        let cameras = batch
            .refines_cameras
            .then(|| CameraAdjoints::new(Vec::new(), batch.scene.cameras.len()));
        Part {
            batch,
            first: place.start,
            pixels: &batch.pixels[place],
            seed: Stream::new(batch.seed, Purpose::Part).at(number as u64).bits(),
            share: 1.0 / batch.pixel_count,
            adjoints: Adjoints { cameras, ..Adjoints::default() },
            sums,
            gains: vec![DVec3::ZERO; batch.gains.len()],
            stats: BatchStats::default(),
            losses: Vec::new(),
            surface: Vec::new(),
            own: OfPixels::default(),
            edge: OfPixels::default(),
            typical: None,
        }
    }

    /// One uniform random sample in every pixel.
    pub(crate) fn samples(&self) -> Vec<Sample> {
        (self.first..self.first + self.pixels.len()).map(|pixel| self.batch.sample(pixel)).collect()
    }

    /// Gives the part its pixels: those of the batch from the number `first` on, then others that a
    /// silhouette may cross. Returns the number of the former.
    pub(crate) fn set_pixels(&mut self, first: usize, own: OfPixels) -> usize {
        let smooth = own.pixels.len().min(self.batch.pixels.len() - first);
        self.first = first;
        self.pixels = &self.batch.pixels[first..first + smooth];
        self.losses = own.photometric();
        self.losses.truncate(smooth);
        let is_carved = |pixel: usize| self.losses.get(pixel).is_some_and(|loss| loss.is_some());
        self.surface = own.hits().filter(|(pixel, _)| is_carved(*pixel)).collect();
        self.own = own;
        smooth
    }

    /// Adds the loss of one pixel to the sums, and returns the adjoint of its radiance.
    pub(crate) fn add_loss(&mut self, own: &PixelLoss, p: &Pixel) -> Vec3 {
        let count = f64::from(p.count);
        self.stats.photometric += f64::from(own.loss) * count;
        self.stats.squared_error += f64::from(own.squared_error) * count;
        let adjoint = own.adjoint * (self.share * f32::from(p.count));
        if let Some(sum) = self.gains.get_mut(p.view as usize) {
            *sum += (adjoint * own.shown).as_dvec3();
        }
        adjoint * self.batch.gain(p)
    }

    /// Adds the terms that need numbers of the whole batch: pushes, and with a sharp surface also
    /// the photometric and the eikonal term. `pushes` has one number for each pixel of the batch,
    /// or is empty.
    pub(crate) fn finish(&mut self, pushes: &[f32]) {
        if !pushes.is_empty() {
            self.carve(&pushes[self.first..self.first + self.pixels.len()]);
        }
        if self.batch.sharpness.is_none() {
            self.add_sharp_pixels();
        }
    }
}
