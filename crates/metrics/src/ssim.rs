//! Structural similarity of images.
//!
//! Z. Wang, A. C. Bovik, H. R. Sheikh, E. P. Simoncelli, "Image quality assessment: from error
//! visibility to structural similarity", IEEE Transactions on Image Processing 2004. Window and
//! constants are the paper's.

use film::Film;

use crate::image::{assert_same_size, display_values};

/// The standard deviation of the Gaussian window, in pixels.
const SIGMA: f64 = 1.5;

/// The half width of the window, in pixels, without its centre.
const HALF: usize = 5;

/// The width of the window, in pixels.
const WINDOW: usize = 2 * HALF + 1;

/// The constants C₁ and C₂ of the paper, which keep both fractions finite where an image is dark or
/// uniform: K₁² and K₂² for values from 0 to 1.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// The structural similarity (SSIM; Wang, Bovik, Sheikh, Simoncelli 2004); 1 for equal images.
///
/// The window is 11 × 11 pixels, Gaussian with σ = 1.5 pixels; K₁ = 0.01, K₂ = 0.03. The result is
/// the mean over all windows that lie inside the image and over the three display channels (sRGB,
/// clipped to [0, 1]); the paper uses luminance alone. NaN if an image is smaller than a window or
/// holds a NaN.
///
/// # Panics
/// If the images differ in size.
pub fn ssim(a: &Film, b: &Film) -> f64 {
    assert_same_size(a, b);
    let size = Size { width: a.width as usize, height: a.height as usize };
    if size.width < WINDOW || size.height < WINDOW {
        return f64::NAN;
    }
    let (x, y) = (display_values(a), display_values(b));
    let mut total = 0.0;
    for c in 0..3 {
        let channel = |v: &[f64]| v.iter().skip(c).step_by(3).copied().collect::<Vec<f64>>();
        total += channel_ssim(&channel(&x), &channel(&y), size);
    }
    total / 3.0
}

/// The size of an image, in pixels.
#[derive(Clone, Copy)]
struct Size {
    width: usize,
    height: usize,
}

/// The mean over all windows of one channel.
fn channel_ssim(x: &[f64], y: &[f64], size: Size) -> f64 {
    let mean = |v: &[f64]| window_means(v, size);
    let mean_product =
        |p: &[f64], q: &[f64]| mean(&p.iter().zip(q).map(|(p, q)| p * q).collect::<Vec<f64>>());
    let (mx, my) = (mean(x), mean(y));
    let (xx, yy, xy) = (mean_product(x, x), mean_product(y, y), mean_product(x, y));
    let local = (0..mx.len()).map(|i| {
        let variance_x = xx[i] - mx[i] * mx[i];
        let variance_y = yy[i] - my[i] * my[i];
        let covariance = xy[i] - mx[i] * my[i];
        (2.0 * mx[i] * my[i] + C1) * (2.0 * covariance + C2)
            / ((mx[i] * mx[i] + my[i] * my[i] + C1) * (variance_x + variance_y + C2))
    });
    local.sum::<f64>() / mx.len() as f64
}

/// The weighted mean of every window that lies inside the image. The Gaussian is separable: rows
/// are averaged first, then columns.
fn window_means(v: &[f64], Size { width, height }: Size) -> Vec<f64> {
    let weights: [f64; WINDOW] =
        std::array::from_fn(|i| (-0.5 * ((i as f64 - HALF as f64) / SIGMA).powi(2)).exp());
    let (columns, rows) = (width - 2 * HALF, height - 2 * HALF);
    let mut row_means = Vec::with_capacity(columns * height);
    for y in 0..height {
        row_means.extend((0..columns).map(|x| weighted_mean(&weights, |i| v[y * width + x + i])));
    }
    let mut means = Vec::with_capacity(columns * rows);
    for y in 0..rows {
        let row = |x: usize| weighted_mean(&weights, |i| row_means[(y + i) * columns + x]);
        means.extend((0..columns).map(row));
    }
    means
}

fn weighted_mean(weights: &[f64; WINDOW], value: impl Fn(usize) -> f64) -> f64 {
    let sum: f64 = weights.iter().sum();
    weights.iter().enumerate().map(|(i, w)| w * value(i)).sum::<f64>() / sum
}
