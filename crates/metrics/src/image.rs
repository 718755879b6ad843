//! PSNR and mask IoU, and the display values that image metrics compare.

use film::{Film, srgb_encode};

/// The PSNR of equal images, in dB.
///
/// Without a cap it would be infinite, which JSON cannot hold. Images that differ everywhere by one
/// step of 8 bits have 48 dB, and by one step of 16 bits 96 dB: the cap is above both.
const PSNR_CAP: f64 = 99.0;

/// The sRGB values of all channels, clipped to [0, 1], pixel after pixel. A NaN stays a NaN.
pub(crate) fn display_values(film: &Film) -> Vec<f64> {
    film.pixels.as_flattened().iter().map(|v| f64::from(srgb_encode(*v).clamp(0.0, 1.0))).collect()
}

pub(crate) fn assert_same_size(a: &Film, b: &Film) {
    assert_eq!((a.width, a.height), (b.width, b.height), "the images differ in size");
}

/// The peak signal-to-noise ratio in dB, at most 99 (equal images).
///
/// It is −10 log₁₀ of the mean squared difference of display values (sRGB, clipped to [0, 1]) over
/// all pixels and channels. NaN if an image holds a NaN.
///
/// # Panics
/// If the images differ in size.
pub fn psnr(a: &Film, b: &Film) -> f64 {
    psnr_where(a, b, std::iter::repeat(true)).unwrap_or(PSNR_CAP)
}

/// [`psnr`] over the pixels that `used` flags, row-major; `None` if it flags none.
///
/// # Panics
/// If the images differ in size.
pub fn psnr_where(a: &Film, b: &Film, used: impl IntoIterator<Item = bool>) -> Option<f64> {
    assert_same_size(a, b);
    let (a, b) = (display_values(a), display_values(b));
    let (mut squares, mut count) = (0.0, 0);
    let pixels = a.chunks_exact(3).zip(b.chunks_exact(3)).zip(used);
    for ((a, b), _) in pixels.filter(|(_, used)| *used) {
        squares += a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        count += 3;
    }
    let mean = squares / f64::from(count);
    // Not `f64::min`: it would return the cap for a NaN.
    let psnr = if mean < 10f64.powf(-0.1 * PSNR_CAP) { PSNR_CAP } else { -10.0 * mean.log10() };
    (count > 0).then_some(psnr)
}

/// The intersection over union of two masks, from 0 to 1; 1 if both are empty.
///
/// A pixel is in a mask if its value is at least one half; a NaN is not.
///
/// # Panics
/// If the masks differ in length.
pub fn mask_iou(coverage: &[f32], mask: &[f32]) -> f64 {
    assert_eq!(coverage.len(), mask.len(), "the masks differ in the number of pixels");
    let count = |f: &dyn Fn(bool, bool) -> bool| {
        coverage.iter().zip(mask).filter(|(a, b)| f(**a >= 0.5, **b >= 0.5)).count() as f64
    };
    let union = count(&|a, b| a || b);
    if union == 0.0 { 1.0 } else { count(&|a, b| a && b) / union }
}
