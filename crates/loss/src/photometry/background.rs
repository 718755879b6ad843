//! The probability that a pixel shows the background.

use field::Sphere;
use inspect::{BackgroundEstimate, Picture};

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
    /// The picture behind all views, in the place of a colour.
    pub picture: Option<Picture>,
    /// Whether the background is trained: pixels whose rays miss the bounding sphere then count.
    pub is_trained: bool,
}

impl BackgroundModel {
    /// The estimated background of a view.
    fn estimate(&self, view: usize) -> &BackgroundEstimate {
        &self.estimates[view.min(self.estimates.len() - 1)]
    }

    /// For each pixel, row-major, whether it and all pixels in the margin around it are certain
    /// background.
    pub fn certain(&self, view: usize, photograph: &Photograph) -> Vec<bool> {
        let (width, height) = (photograph.image.width, photograph.image.height);
        let certain: Vec<bool> = match (&photograph.coverage, &self.picture) {
            (Some(coverage), _) => coverage.pixels.iter().map(|c| 1.0 - c[0] > CERTAIN).collect(),
            (None, Some(picture)) => {
                let probability = picture.probabilities_at([width, height], view);
                let pixels = photograph.image.pixels.iter().enumerate();
                pixels.map(|(i, rgb)| probability(i, *rgb) > CERTAIN).collect()
            }
            (None, None) if self.estimate(view).confidence > KNOWN => {
                let probability = self.estimate(view).probabilities();
                photograph.image.pixels.iter().map(|rgb| probability(*rgb) > CERTAIN).collect()
            }
            (None, None) => return vec![false; photograph.image.pixels.len()],
        };
        with_margin(&certain, [width, height], (width.max(height) / MARGIN).max(1))
    }
}

#[cfg(test)]
mod tests {
    use field::Sphere;
    use film::Film;
    use glam::DVec3;

    use super::*;

    #[test]
    fn pixels_that_show_the_picture_are_certain_but_for_those_near_others() {
        let pixel = |i: u32| [0.2 + 0.1 * (i % 4) as f32, 0.3, 0.5];
        let image = Film { width: 8, height: 8, pixels: (0..64).map(pixel).collect() };
        let is_known: Vec<bool> = (0..64).map(|i| i != 63).collect();
        let picture = Picture::new(image.clone(), is_known, 0.01, Vec::new()).unwrap();
        let model = BackgroundModel {
            bounds: Sphere { center: DVec3::ZERO, radius: 1.0 },
            estimates: vec![BackgroundEstimate { confidence: 0.0, ..BackgroundEstimate::NOTHING }],
            picture: Some(picture),
            is_trained: false,
        };
        let mut photograph = Photograph::of_image(image);
        photograph.image.pixels[0] = [0.9, 0.1, 0.1];
        let certain = model.certain(0, &photograph);
        // The object in one corner, an unknown pixel in the other, and a margin of one pixel.
        let expected = |i: usize| {
            let (x, y) = (i % 8, i / 8);
            !((x < 2 && y < 2) || (x > 5 && y > 5))
        };
        assert_eq!(certain, (0..64).map(expected).collect::<Vec<bool>>());
    }
}
