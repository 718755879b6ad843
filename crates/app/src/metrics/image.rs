//! Image metrics, in display space (sRGB, clipped to [0, 1]).

use crate::film::{Film, srgb_encode};

fn shown(film: &Film) -> Vec<f64> {
    film.pixels.as_flattened().iter().map(|v| f64::from(srgb_encode(*v).clamp(0.0, 1.0))).collect()
}

/// The PSNR of equal images, in dB: beyond what 8 bits (48 dB) or any photograph can tell apart.
const PSNR_CAP: f64 = 99.0;

/// The peak signal-to-noise ratio over all pixels and channels, in dB, at most 99 (equal images).
pub fn psnr(a: &Film, b: &Film) -> f64 {
    let (a, b) = (shown(a), shown(b));
    let mean = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len().max(1) as f64;
    (-10.0 * mean.log10()).min(PSNR_CAP)
}

/// The standard deviation of SSIM's Gaussian window, in pixels, and its half width.
const SIGMA: f64 = 1.5;
const HALF: usize = 5;

/// Structural similarity (Wang et al. 2004): an 11 × 11 Gaussian window with σ = 1.5, K₁ = 0.01, K₂ = 0.03, the mean over
/// channels and over all windows that lie inside the image. 1 for images too small for a window if they are equal.
pub fn ssim(a: &Film, b: &Film) -> f64 {
    let (width, height) = (a.width as usize, a.height as usize);
    let (x, y) = (shown(a), shown(b));
    if width <= 2 * HALF || height <= 2 * HALF {
        return f64::from(u8::from(x == y));
    }
    let mut total = 0.0;
    for c in 0..3 {
        let channel = |v: &[f64]| v.iter().skip(c).step_by(3).copied().collect::<Vec<f64>>();
        let (x, y) = (channel(&x), channel(&y));
        let product = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(p, q)| p * q).collect::<Vec<f64>>();
        let blur = |v: &[f64]| blur(v, width, height);
        let (mx, my) = (blur(&x), blur(&y));
        let (xx, yy, xy) = (blur(&product(&x, &x)), blur(&product(&y, &y)), blur(&product(&x, &y)));
        let (c1, c2) = (0.01f64.powi(2), 0.03f64.powi(2));
        let local = (0..mx.len()).map(|i| {
            let (vx, vy, vxy) = (xx[i] - mx[i] * mx[i], yy[i] - my[i] * my[i], xy[i] - mx[i] * my[i]);
            (2.0 * mx[i] * my[i] + c1) * (2.0 * vxy + c2) / ((mx[i] * mx[i] + my[i] * my[i] + c1) * (vx + vy + c2))
        });
        total += local.sum::<f64>() / mx.len() as f64;
    }
    total / 3.0
}

/// The Gaussian window's weighted mean at every place where it fits.
fn blur(v: &[f64], width: usize, height: usize) -> Vec<f64> {
    let weight: Vec<f64> = (0..=2 * HALF).map(|i| (-0.5 * ((i as f64 - HALF as f64) / SIGMA).powi(2)).exp()).collect();
    let sum: f64 = weight.iter().sum();
    let inner = width - 2 * HALF;
    let mut rows = Vec::with_capacity(inner * height);
    for y in 0..height {
        for x in 0..inner {
            rows.push(weight.iter().enumerate().map(|(i, w)| w * v[y * width + x + i]).sum::<f64>() / sum);
        }
    }
    let mut out = Vec::with_capacity(inner * (height - 2 * HALF));
    for y in 0..height - 2 * HALF {
        for x in 0..inner {
            out.push(weight.iter().enumerate().map(|(i, w)| w * rows[(y + i) * inner + x]).sum::<f64>() / sum);
        }
    }
    out
}

/// Intersection over union of a coverage and a mask, both at least one half. 1 if both are empty.
pub fn mask_iou(coverage: &[f32], mask: &[f32]) -> f64 {
    let count = |f: &dyn Fn(bool, bool) -> bool| {
        coverage.iter().zip(mask).filter(|(a, b)| f(**a >= 0.5, **b >= 0.5)).count() as f64
    };
    let either = count(&|a, b| a || b);
    if either == 0.0 { 1.0 } else { count(&|a, b| a && b) / either }
}
