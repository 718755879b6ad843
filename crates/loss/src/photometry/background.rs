//! The probability that a pixel shows the background.

use std::ops::RangeInclusive;

use field::Sphere;
use inspect::BackgroundEstimate;

use crate::photometry::pyramid::Photograph;

/// A pixel with more than this probability counts as certain background. At 0.9 and 0.999: distance
/// 1.00 and 1.04 (see the evidence in
/// the module `loss::schedule`).
const CERTAIN: f32 = 0.99;

/// The margin around a pixel that must also be certain background, as the fraction 1/MARGIN of the
/// longer side of the image. Silhouettes come to rest inside such a margin. At 1/16 and 1/64:
/// distance 1.01 and 1.05.
const MARGIN: u32 = 32;

/// Without masks, pixels are certain only if the confidence in the background is above this.
const KNOWN: f32 = 0.5;

/// The model that tells background pixels from pixels of the object.
#[derive(Clone, Debug)]
pub struct BackgroundModel {
    /// The bounding sphere of the object, in world units.
    pub bounds: Sphere<f64>,
    /// The estimated colour of the background: one for all views, or one for each.
    pub estimates: Vec<BackgroundEstimate>,
    /// Whether the background is trained: pixels whose rays miss the bounding sphere then count.
    pub is_trained: bool,
}

impl BackgroundModel {
    /// The estimated background of a view.
    fn estimate(&self, view: usize) -> &BackgroundEstimate {
        &self.estimates[view.min(self.estimates.len() - 1)]
    }

    /// The probability, 0 to 1, that pixel (x, y) of a view shows the background.
    pub fn probability(&self, view: usize, photograph: &Photograph, x: u32, y: u32) -> f32 {
        match &photograph.coverage {
            Some(coverage) => 1.0 - coverage.at(x, y)[0],
            None => self.estimate(view).probability(photograph.image.at(x, y)),
        }
    }

    /// For each pixel, row-major, whether it and all pixels in the margin around it are certain
    /// background.
    pub fn certain(&self, view: usize, photograph: &Photograph) -> Vec<bool> {
        let (width, height) = (photograph.image.width, photograph.image.height);
        let known = self.estimate(view).confidence > KNOWN || photograph.coverage.is_some();
        let all = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let certain: Vec<bool> = all()
            .map(|(x, y)| known && self.probability(view, photograph, x, y) > CERTAIN)
            .collect();
        with_margin(&certain, [width, height], (width.max(height) / MARGIN).max(1))
    }
}

/// The places along a side of an image that are up to `margin` from `v`.
pub(crate) fn near(v: u32, margin: u32, side: u32) -> RangeInclusive<u32> {
    v.saturating_sub(margin)..=(v + margin).min(side - 1)
}

/// For each pixel of an image, row-major, whether it and all pixels in the square with this margin
/// around it are flagged.
pub(crate) fn with_margin(flags: &[bool], [width, height]: [u32; 2], margin: u32) -> Vec<bool> {
    let all = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let near = |v: u32, side: u32| near(v, margin, side);
    // A square is a row of columns: test the columns first, then the rows.
    let columns: Vec<bool> =
        all().map(|(x, y)| near(y, height).all(|y| flags[(y * width + x) as usize])).collect();
    all().map(|(x, y)| near(x, width).all(|x| columns[(y * width + x) as usize])).collect()
}
