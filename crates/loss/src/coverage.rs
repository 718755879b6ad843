//! The term of the coverage: pixels with the loss of the object belong to the object, and pixels
//! with the loss of the background to the background.
//!
//! In front of another picture in each photograph, a surface in the mean colour of the pictures explains
//! a pixel beside the object as well as the background does. No radiance holds the silhouette
//! there. But the object's own pixels have a far smaller loss than those of the background.

use crate::photometry::Draw;

/// The term is used where the background's mean loss is above this multiple of the object's.
const LEAST_RATIO: f32 = 2.0;

/// The least number of draws of the object and of the background that a mean needs.
const LEAST_DRAWS: usize = 20;

/// The losses of pixels that no silhouette crosses, background first: of those that show it, and of
/// those that show the object.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MeanLosses {
    sum: [f32; 2],
    pixels: [f32; 2],
    draws: [usize; 2],
}

impl MeanLosses {
    /// Of pixels that show the object or not. Pixels without a loss do not count.
    pub(crate) fn of(drawn: &[Draw], is_object: &[bool], losses: &[Option<f32>]) -> Self {
        let mut all = Self::default();
        for ((draw, is_object), loss) in drawn.iter().zip(is_object).zip(losses) {
            let (Some(loss), count) = (loss, f32::from(draw.count)) else { continue };
            all.sum[usize::from(*is_object)] += loss * count;
            all.pixels[usize::from(*is_object)] += count;
            all.draws[usize::from(*is_object)] += 1;
        }
        all
    }

    /// The mean over pixels that show the object; 0 without any.
    pub(crate) fn of_object(&self) -> f32 {
        if self.pixels[1] > 0.0 { self.sum[1] / self.pixels[1] } else { 0.0 }
    }

    /// The means. `None` if there are too few pixels, or if the background is explained as well as
    /// the object.
    pub(crate) fn typical(&self) -> Option<TypicalLosses> {
        let [background, object] = [0, 1].map(|i| self.sum[i] / self.pixels[i]);
        let is_known = self.draws.iter().all(|count| *count >= LEAST_DRAWS);
        let is_used = is_known && background > LEAST_RATIO * object;
        is_used.then_some(TypicalLosses { object, background })
    }
}

/// The mean losses of the object and of a background that is explained worse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TypicalLosses {
    object: f32,
    background: f32,
}

impl TypicalLosses {
    /// The derivative by the coverage C of the term (ρ − e)²/2b of a pixel with the loss ρ, where
    /// e = C s + (1 − C) b is the loss to expect, with the mean losses s of the object and b of the
    /// background. ρ counts as an observation: the term does not change radiance.
    pub(crate) fn slope(self, coverage: f32, loss: f32) -> f32 {
        let TypicalLosses { object, background } = self;
        let expected = coverage * object + (1.0 - coverage) * background;
        (loss - expected) * (background - object) / background
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// 40 pixels of this count, half of them of the object and half of the background, with these
    /// losses, and one without a loss.
    fn losses(object: f32, background: f32, count: u16) -> Option<TypicalLosses> {
        let of = |i: u16| [background, object][usize::from(i % 2)] + f32::from(i % 4 / 2) * 0.02;
        let pixels: Vec<Draw> = (0..41).map(|x| Draw { view: 0, x, y: 0, count }).collect();
        let is_object: Vec<bool> = (0..41).map(|i| i % 2 == 1).collect();
        let losses: Vec<Option<f32>> = (0..40).map(|i| Some(of(i) - 0.01)).chain([None]).collect();
        MeanLosses::of(&pixels, &is_object, &losses).typical()
    }

    #[test]
    fn typical_losses_need_pixels_and_an_unexplained_background() {
        let found = losses(0.1, 0.8, 1).unwrap();
        assert_relative_eq!(found.object, 0.1, epsilon = 1e-6);
        assert_relative_eq!(found.background, 0.8, epsilon = 1e-6);
        assert_eq!(losses(0.1, 0.8, 0), None, "too few draws");
        assert_eq!(losses(0.4, 0.7, 1), None, "a background that is explained");
        assert_eq!(losses(0.4, 0.1, 1), None, "a background that is explained better");
        let none = MeanLosses::of(&[], &[], &[]);
        assert_eq!((none.typical(), none.of_object()), (None, 0.0));
    }

    #[test]
    fn the_slope_is_the_derivative_of_the_term_and_zero_at_the_true_coverage() {
        let typical = losses(0.1, 0.8, 1).unwrap();
        let expected = |c: f32| 0.1 * c + 0.8 * (1.0 - c);
        let term = |c: f32, loss: f32| (loss - expected(c)).powi(2) / (2.0 * 0.8);
        for coverage in [0.0, 0.3, 1.0] {
            for loss in [0.0, 0.2, 1.5] {
                let h = 0.01;
                let difference = (term(coverage + h, loss) - term(coverage - h, loss)) / (2.0 * h);
                let slope = typical.slope(coverage, loss);
                assert_relative_eq!(slope, difference, epsilon = 1e-4);
            }
            assert_relative_eq!(typical.slope(coverage, expected(coverage)), 0.0, epsilon = 1e-6);
        }
        // A covered pixel with the loss of the background should be less covered.
        assert!(typical.slope(1.0, 0.8) > 0.0 && typical.slope(0.0, 0.1) < 0.0);
    }
}
