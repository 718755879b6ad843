//! The photometric loss, in display space.

use film::{Film, srgb_encode};

/// Where the loss turns from quadratic to linear, in display units: about the noise of a photograph
/// with its unmodelled highlights. Half and double of it changed the fits of the test scenes by
/// less than their seed did.
const SOFTNESS: f32 = 0.05;

/// The least difference of radiance that the encoding's slope is taken over: at black the slope
/// itself is twenty times that of white, and noise there would drown all else.
const LEAST_CONTRAST: f32 = 0.1;

/// What a pixel should look like.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Target {
    /// Its linear radiance.
    pub(crate) radiance: [f32; 3],
    /// Display units per unit of radiance.
    slope: [f32; 3],
}

impl Target {
    /// The target of a pixel of a photograph.
    ///
    /// The slope is that of the line through the darkest and the brightest of the pixel and its
    /// neighbours, on the curve of the display's encoding. So what it says of a silhouette's place
    /// is how wrong the coverage is, at the contrast that is seen. It does not depend on the
    /// samples: the curve's own slope at a noisy estimate is steep if that happens to be dark, and
    /// moves every silhouette before a dark background outwards (half a pixel with four samples).
    pub(crate) fn of(image: &Film, x: u32, y: u32) -> Self {
        let (mut low, mut high) = ([f32::INFINITY; 3], [0.0f32; 3]);
        for y in y.saturating_sub(1)..=(y + 1).min(image.height - 1) {
            for x in x.saturating_sub(1)..=(x + 1).min(image.width - 1) {
                for (c, v) in image.at(x, y).into_iter().enumerate() {
                    (low[c], high[c]) = (low[c].min(v), high[c].max(v));
                }
            }
        }
        let slope = std::array::from_fn(|c| {
            let high = high[c].max(low[c] + LEAST_CONTRAST);
            (srgb_encode(high) - srgb_encode(low[c])) / (high - low[c])
        });
        Target { radiance: image.at(x, y), slope }
    }
}

/// Charbonnier loss of a pixel, Σ_c √(r_c² + s²) − s with r in display units, and its derivative by
/// linear radiance.
///
/// Display units weigh dark and bright parts as an eye, and the PSNR, would.
pub(crate) fn photometric(radiance: [f32; 3], target: &Target) -> (f32, [f32; 3]) {
    let mut loss = 0.0;
    let adjoint = std::array::from_fn(|c| {
        let residual = target.slope[c] * (radiance[c] - target.radiance[c]);
        let root = residual.hypot(SOFTNESS);
        loss += root - SOFTNESS;
        residual / root * target.slope[c]
    });
    (loss, adjoint)
}

/// The squared error of a pixel in display space, clipped to what a display shows; the mean of it
/// gives the PSNR.
pub(crate) fn squared_error(radiance: [f32; 3], target: [f32; 3]) -> f32 {
    let shown = |v: f32| srgb_encode(v).clamp(0.0, 1.0);
    (0..3).map(|c| (shown(radiance[c]) - shown(target[c])).powi(2)).sum::<f32>() / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn adjoint_matches_differences(radiance in prop::array::uniform3(0.005f32..1.0), target in prop::array::uniform3(0.0f32..1.0)) {
            let image = Film { width: 2, height: 1, pixels: vec![target, [0.2; 3]] };
            let target = Target::of(&image, 0, 0);
            let (_, adjoint) = photometric(radiance, &target);
            for c in 0..3 {
                let moved = |h: f32| {
                    let mut r = radiance;
                    r[c] += h;
                    f64::from(photometric(r, &target).0)
                };
                let h = 1e-3 * radiance[c];
                let difference = (moved(h) - moved(-h)) / (2.0 * f64::from(h));
                prop_assert!((f64::from(adjoint[c]) - difference).abs() < 2e-2 * (1.0 + difference.abs()), "{} against {difference}", adjoint[c]);
            }
        }
    }

    #[test]
    fn slopes_are_of_the_neighbourhood() {
        let (mut image, at) = (Film::new(5, 5), |image: &Film| Target::of(image, 2, 2).slope[1]);
        assert_relative_eq!(at(&image), srgb_encode(LEAST_CONTRAST) / LEAST_CONTRAST);
        image.pixels[6] = [0.5; 3];
        assert_relative_eq!(at(&image), srgb_encode(0.5) / 0.5);
        image.pixels[4] = [0.9; 3];
        assert_relative_eq!(at(&image), srgb_encode(0.5) / 0.5);
        assert_relative_eq!(Target::of(&image, 4, 0).slope[1], srgb_encode(0.9) / 0.9);
    }
}
