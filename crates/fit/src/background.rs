//! Which pixels show the background.

use dataset::Background;
use field::Sphere;
use film::Film;

/// The probability from which a pixel counts as certain background.
const CERTAIN: f32 = 0.99;

/// The margin around a background pixel that must be certain background too, as a fraction 1/MARGIN
/// of the image's larger side: silhouettes come to rest inside it.
const MARGIN: u32 = 32;

/// The confidence of the estimated background above which pixels may be certain.
const KNOWN: f32 = 0.5;

/// The evidence for background pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BackgroundModel {
    /// The ball that holds the object.
    pub(crate) bounds: Sphere<f64>,
    /// The estimated colour of the background.
    pub(crate) background: Background,
    /// Whether masks decide where a view has one.
    pub(crate) use_masks: bool,
}

impl BackgroundModel {
    /// The probability that a pixel shows the background.
    pub(crate) fn probability(&self, image: &Film, mask: Option<&Film>, x: u32, y: u32) -> f32 {
        match mask.filter(|_| self.use_masks) {
            Some(mask) => 1.0 - mask.at(x, y)[0],
            None => self.background.probability(image.at(x, y)),
        }
    }

    /// For each pixel, row-major, whether it and those around it are certain background.
    pub(crate) fn certain(&self, image: &Film, mask: Option<&Film>) -> Vec<bool> {
        let (width, height) = (image.width, image.height);
        let known = self.background.confidence > KNOWN || (self.use_masks && mask.is_some());
        let all = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let certain: Vec<bool> =
            all().map(|(x, y)| known && self.probability(image, mask, x, y) > CERTAIN).collect();
        let margin = (width.max(height) / MARGIN).max(1);
        let near = |v: u32, side: u32| v.saturating_sub(margin)..=(v + margin).min(side - 1);
        // The square around a pixel is a row of columns.
        let columns: Vec<bool> = all()
            .map(|(x, y)| near(y, height).all(|y| certain[(y * width + x) as usize]))
            .collect();
        all().map(|(x, y)| near(x, width).all(|x| columns[(y * width + x) as usize])).collect()
    }
}
