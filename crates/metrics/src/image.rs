//! Image metrics, in display space (sRGB, clipped to [0, 1]).
//!
//! An image that holds a NaN has no metric: the result is NaN, and never a number that could pass
//! for one.

use film::{Film, srgb_encode};

fn shown(film: &Film) -> Vec<f64> {
    film.pixels.as_flattened().iter().map(|v| f64::from(srgb_encode(*v).clamp(0.0, 1.0))).collect()
}

/// The PSNR of equal images, in dB, which would be infinite and so could not be written as JSON.
/// Images that differ by one step of 8 bits everywhere have 48 dB, and by one step of 16 bits, 96
/// dB.
const PSNR_CAP: f64 = 99.0;

fn assert_same_size(a: &Film, b: &Film) {
    assert_eq!((a.width, a.height), (b.width, b.height), "images are compared at one size");
}

/// The peak signal-to-noise ratio over all pixels and channels, in dB, at most 99 (equal images).
///
/// # Panics
/// If the images differ in size.
pub fn psnr(a: &Film, b: &Film) -> f64 {
    assert_same_size(a, b);
    let (a, b) = (shown(a), shown(b));
    let mean = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len().max(1) as f64;
    // `min` would take a NaN for the cap.
    if mean < 10f64.powf(-0.1 * PSNR_CAP) { PSNR_CAP } else { -10.0 * mean.log10() }
}

/// The standard deviation of SSIM's Gaussian window, in pixels, and its half width.
const SIGMA: f64 = 1.5;
const HALF: usize = 5;

/// Structural similarity (Wang et al. 2004): an 11 × 11 Gaussian window with σ = 1.5, K₁ = 0.01, K₂
/// = 0.03, of each display channel (not of luminance), the mean over channels and over all windows
/// that lie inside the image. NaN for images smaller than a window, which have none.
///
/// # Panics
/// If the images differ in size.
pub fn ssim(a: &Film, b: &Film) -> f64 {
    assert_same_size(a, b);
    let (width, height) = (a.width as usize, a.height as usize);
    if width <= 2 * HALF || height <= 2 * HALF {
        return f64::NAN;
    }
    let (x, y) = (shown(a), shown(b));
    let mut total = 0.0;
    for c in 0..3 {
        let channel = |v: &[f64]| v.iter().skip(c).step_by(3).copied().collect::<Vec<f64>>();
        let (x, y) = (channel(&x), channel(&y));
        let product =
            |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(p, q)| p * q).collect::<Vec<f64>>();
        let blur = |v: &[f64]| blur(v, width, height);
        let (mx, my) = (blur(&x), blur(&y));
        let (xx, yy, xy) = (blur(&product(&x, &x)), blur(&product(&y, &y)), blur(&product(&x, &y)));
        let (c1, c2) = (0.01f64.powi(2), 0.03f64.powi(2));
        let local = (0..mx.len()).map(|i| {
            let (vx, vy, vxy) =
                (xx[i] - mx[i] * mx[i], yy[i] - my[i] * my[i], xy[i] - mx[i] * my[i]);
            (2.0 * mx[i] * my[i] + c1) * (2.0 * vxy + c2)
                / ((mx[i] * mx[i] + my[i] * my[i] + c1) * (vx + vy + c2))
        });
        total += local.sum::<f64>() / mx.len() as f64;
    }
    total / 3.0
}

/// The Gaussian window's weighted mean at every place where it fits.
fn blur(v: &[f64], width: usize, height: usize) -> Vec<f64> {
    let weight: Vec<f64> =
        (0..=2 * HALF).map(|i| (-0.5 * ((i as f64 - HALF as f64) / SIGMA).powi(2)).exp()).collect();
    let sum: f64 = weight.iter().sum();
    let inner = width - 2 * HALF;
    let mut rows = Vec::with_capacity(inner * height);
    for y in 0..height {
        for x in 0..inner {
            rows.push(
                weight.iter().enumerate().map(|(i, w)| w * v[y * width + x + i]).sum::<f64>() / sum,
            );
        }
    }
    let mut out = Vec::with_capacity(inner * (height - 2 * HALF));
    for y in 0..height - 2 * HALF {
        for x in 0..inner {
            out.push(
                weight.iter().enumerate().map(|(i, w)| w * rows[(y + i) * inner + x]).sum::<f64>()
                    / sum,
            );
        }
    }
    out
}

/// Intersection over union of a coverage and a mask, each at least one half (a NaN is not). 1 if
/// both are empty.
///
/// # Panics
/// If they differ in length.
pub fn mask_iou(coverage: &[f32], mask: &[f32]) -> f64 {
    assert_eq!(coverage.len(), mask.len(), "a mask has as many pixels as the coverage");
    let count = |f: &dyn Fn(bool, bool) -> bool| {
        coverage.iter().zip(mask).filter(|(a, b)| f(**a >= 0.5, **b >= 0.5)).count() as f64
    };
    let either = count(&|a, b| a || b);
    if either == 0.0 { 1.0 } else { count(&|a, b| a && b) / either }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use film::srgb_decode;

    /// 24 × 20 pixels whose display values are `f(column, row, channel)`.
    fn film(f: impl Fn(f64, f64, f64) -> f64) -> Film {
        let pixel = |i: u32| {
            [0.0, 1.0, 2.0].map(|c| srgb_decode(f(f64::from(i % 24), f64::from(i / 24), c) as f32))
        };
        Film { width: 24, height: 20, pixels: (0..24 * 20).map(pixel).collect() }
    }

    fn wave(amplitude: f64, shift: f64) -> Film {
        film(|x, y, c| {
            0.5 + amplitude * (0.7 * x + 0.3 * y + c + shift).sin() * (0.2 * x * y / 10.0 + c).cos()
        })
    }

    /// The same images, as formulas in NumPy, in scikit-image 0.26: `structural_similarity` with
    /// `gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1,
    /// channel_axis=-1`, and `peak_signal_noise_ratio`.
    #[test]
    fn agrees_with_an_independent_program() {
        let ramp = film(|x, y, c| (3.0 * x + 5.0 * y + 7.0 * c) % 17.0 / 17.0);
        for (other, similarity, ratio) in [
            (wave(0.35, 0.3), 0.943_784_237_326_444_3, 24.305_061_165_912_81),
            (ramp, 0.004_744_023_317_336_765, 9.139_738_904_257_547),
            (film(|_, _, _| 0.5), 0.042_953_497_663_233_996, 14.046_254_993_449_443),
        ] {
            assert_relative_eq!(ssim(&wave(0.4, 0.0), &other), similarity, epsilon = 1e-5);
            assert_relative_eq!(psnr(&wave(0.4, 0.0), &other), ratio, epsilon = 1e-4);
        }
    }

    #[test]
    fn equal_images_are_capped_and_light_is_clipped() {
        let image = wave(0.4, 0.0);
        assert_eq!(psnr(&image, &image), 99.0);
        assert_relative_eq!(ssim(&image, &image), 1.0, epsilon = 1e-12);
        let bright = |v: f32| Film { width: 12, height: 12, pixels: vec![[v; 3]; 144] };
        assert_eq!(psnr(&bright(1.0), &bright(7.0)), 99.0);
        assert_relative_eq!(psnr(&bright(0.0), &bright(1.0)), 0.0, epsilon = 1e-5);
        assert_relative_eq!(
            psnr(&bright(0.0), &bright(srgb_decode(1.0 / 255.0))),
            48.130_8,
            epsilon = 1e-3
        );
    }

    #[test]
    fn a_nan_is_never_a_good_picture() {
        let (image, mut poisoned) = (wave(0.4, 0.0), wave(0.4, 0.0));
        poisoned.pixels[250][1] = f32::NAN;
        assert!(psnr(&image, &poisoned).is_nan() && ssim(&image, &poisoned).is_nan());
        assert_eq!(mask_iou(&[f32::NAN, 1.0], &[1.0, 1.0]), 0.5);
    }

    #[test]
    fn small_images_have_no_similarity_and_empty_masks_agree() {
        let small = Film::new(10, 30);
        assert!(ssim(&small, &small).is_nan());
        assert_eq!(mask_iou(&[0.0; 3], &[0.4; 3]), 1.0);
        assert_eq!(mask_iou(&[1.0, 0.5, 0.0, 0.0], &[1.0, 0.0, 0.7, 0.0]), 1.0 / 3.0);
    }
}
