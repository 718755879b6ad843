//! The probability that a pixel shows the background.

use field::Sphere;
use inspect::BackgroundEstimate;

use crate::photometry::margin::with_margin;
use crate::photometry::photograph::Photograph;

/// A pixel with more than this probability counts as certain background. At 0.9 and 0.999: distance
/// 1.00 and 1.04 (see the evidence in the
/// module `loss::schedule`).
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
