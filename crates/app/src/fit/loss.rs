//! The photometric loss, in display space.

use crate::film::srgb_encode;

/// Where the loss turns from quadratic to linear, in display units: about the noise of a photograph with its unmodelled
/// highlights. Half and double of it changed the fits of the test scenes by less than their seed did.
const SOFTNESS: f32 = 0.05;

/// Charbonnier loss of a pixel, Σ_c s (√(r_c² + s²) − s)/s… in display space, and its derivative by linear radiance.
///
/// Display space weighs dark and bright parts as an eye, and the PSNR, would.
pub(crate) fn photometric(radiance: [f32; 3], target: [f32; 3]) -> (f32, [f32; 3]) {
    let mut loss = 0.0;
    let adjoint = std::array::from_fn(|c| {
        let residual = srgb_encode(radiance[c]) - srgb_encode(target[c]);
        let root = residual.hypot(SOFTNESS);
        loss += root - SOFTNESS;
        residual / root * encode_slope(radiance[c])
    });
    (loss, adjoint)
}

/// The derivative of the sRGB encoding.
fn encode_slope(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 } else { 1.055 / 2.4 * linear.powf(1.0 / 2.4 - 1.0) }
}

/// The squared error of a pixel in display space, clipped to what a display shows; the mean of it gives the PSNR.
pub(crate) fn squared_error(radiance: [f32; 3], target: [f32; 3]) -> f32 {
    let shown = |v: f32| srgb_encode(v).clamp(0.0, 1.0);
    (0..3).map(|c| (shown(radiance[c]) - shown(target[c])).powi(2)).sum::<f32>() / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn adjoint_matches_differences(radiance in prop::array::uniform3(0.005f32..1.0), target in prop::array::uniform3(0.0f32..1.0)) {
            let (_, adjoint) = photometric(radiance, target);
            for c in 0..3 {
                let moved = |h: f32| {
                    let mut r = radiance;
                    r[c] += h;
                    f64::from(photometric(r, target).0)
                };
                let h = 1e-3 * radiance[c];
                let difference = (moved(h) - moved(-h)) / (2.0 * f64::from(h));
                prop_assert!((f64::from(adjoint[c]) - difference).abs() < 2e-2 * (1.0 + difference.abs()), "{} against {difference}", adjoint[c]);
            }
        }
    }
}
