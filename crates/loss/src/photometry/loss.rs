//! The photometric loss, in display units: 0 is black and 1 is the white of a display.

use film::srgb_encode;

use crate::photometry::margin::near;

/// The residual, in display units, at which the loss turns from quadratic to linear: about the
/// noise of a photograph with its unmodelled highlights. Half and double of it changed the fits of
/// the test scenes less than another seed did.
const SOFTNESS: f32 = 0.05;

/// The least difference of radiance over which the slope of the transfer function is taken. At
/// black its slope is twenty times that at white, so noise in dark pixels would dominate the loss.
/// At 0.03 and 0.3: distance 1.10 and 1.09 (see the evidence in the module `loss::schedule`).
const LEAST_CONTRAST: f32 = 0.1;

/// The target of a pixel: its photographed radiance, and the scale of its residual.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// The photographed radiance, linear RGB.
    pub radiance: [f32; 3],
    /// Display units per unit of radiance, for each channel.
    slope: [f32; 3],
}

impl Target {
    /// The target of pixel (x, y) of a photograph of this width and height. `seen` gives the
    /// radiance of its pixels.
    ///
    /// The slope is that of a chord of the sRGB transfer function: from the darkest to the
    /// brightest value among the pixel and its eight neighbours. At a silhouette, the residual is
    /// then the error of the coverage times the contrast in display units.
    ///
    /// The slope does not depend on the samples. The slope of the transfer function at a noisy
    /// estimate is steep if the estimate happens to be dark; that moved silhouettes in front of
    /// dark backgrounds outwards, by half a pixel with four samples.
    pub fn of(
        [width, height]: [u32; 2],
        seen: impl Fn(u32, u32) -> [f32; 3],
        x: u32,
        y: u32,
    ) -> Self {
        let (mut low, mut high) = ([f32::INFINITY; 3], [0.0f32; 3]);
        for y in near(y, 1, height) {
            for x in near(x, 1, width) {
                for (c, v) in seen(x, y).into_iter().enumerate() {
                    (low[c], high[c]) = (low[c].min(v), high[c].max(v));
                }
            }
        }
        let slope = std::array::from_fn(|c| {
            let high = high[c].max(low[c] + LEAST_CONTRAST);
            (srgb_encode(high) - srgb_encode(low[c])) / (high - low[c])
        });
        Target { radiance: seen(x, y), slope }
    }

    /// The weight of each channel's squared error of radiance in least squares that descend the
    /// photometric loss from `radiance`.
    pub(crate) fn weights(&self, radiance: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|c| {
            let slope = self.slope[c];
            slope * slope / (slope * (radiance[c] - self.radiance[c])).hypot(SOFTNESS)
        })
    }
}

/// The photometric loss of a pixel, Σ_c [√(r_c² + s²) − s] with the residual r in display units and
/// s = 0.05, and its derivative by the linear radiance.
///
/// In display units, dark and bright parts have about the weights of human vision and of the PSNR.
///
/// Charbonnier, Blanc-Féraud, Aubert and Barlaud, "Two deterministic half-quadratic regularization
/// algorithms for computed imaging", ICIP 1994.
pub fn photometric(radiance: [f32; 3], target: &Target) -> (f32, [f32; 3]) {
    let mut loss = 0.0;
    let adjoint = std::array::from_fn(|c| {
        let residual = target.slope[c] * (radiance[c] - target.radiance[c]);
        let root = residual.hypot(SOFTNESS);
        loss += root - SOFTNESS;
        residual / root * target.slope[c]
    });
    (loss, adjoint)
}

/// The mean squared error of a pixel over its channels, in display units clipped to [0, 1]. Its
/// mean over pixels gives the PSNR.
pub fn squared_error(radiance: [f32; 3], target: [f32; 3]) -> f32 {
    let display = |v: f32| srgb_encode(v).clamp(0.0, 1.0);
    (0..3).map(|c| (display(radiance[c]) - display(target[c])).powi(2)).sum::<f32>() / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use film::Film;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn adjoint_matches_differences(
            radiance in prop::array::uniform3(0.005f32..1.0),
            target in prop::array::uniform3(0.0f32..1.0),
        ) {
            let image = Film { width: 2, height: 1, pixels: vec![target, [0.2; 3]] };
            let target = Target::of([2, 1], |x, y| image.at(x, y), 0, 0);
            let (_, adjoint) = photometric(radiance, &target);
            for c in 0..3 {
                let moved = |h: f32| {
                    let mut r = radiance;
                    r[c] += h;
                    f64::from(photometric(r, &target).0)
                };
                let h = 1e-3 * radiance[c];
                let difference = (moved(h) - moved(-h)) / (2.0 * f64::from(h));
                prop_assert!(
                    (f64::from(adjoint[c]) - difference).abs() < 2e-2 * (1.0 + difference.abs()),
                    "{} against {difference}", adjoint[c]
                );
            }
        }
    }

    #[test]
    fn the_slope_is_that_of_the_range_of_the_neighbourhood() {
        let slope = |image: &Film, x, y| Target::of([5, 5], |x, y| image.at(x, y), x, y).slope[1];
        let (mut image, at) = (Film::new(5, 5), |image: &Film| slope(image, 2, 2));
        assert_relative_eq!(at(&image), srgb_encode(LEAST_CONTRAST) / LEAST_CONTRAST);
        image.pixels[6] = [0.5; 3];
        assert_relative_eq!(at(&image), srgb_encode(0.5) / 0.5);
        image.pixels[4] = [0.9; 3];
        assert_relative_eq!(at(&image), srgb_encode(0.5) / 0.5);
        assert_relative_eq!(slope(&image, 4, 0), srgb_encode(0.9) / 0.9);
    }
}
