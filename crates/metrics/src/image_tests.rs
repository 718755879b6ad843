use approx::assert_relative_eq;
use film::{Film, srgb_decode};

use crate::{mask_iou, psnr, psnr_where, ssim};

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

/// The expected values are those of scikit-image 0.26 for the same formulas in NumPy:
/// `structural_similarity` with `gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
/// data_range=1, channel_axis=-1`, and `peak_signal_noise_ratio`.
#[test]
fn psnr_and_ssim_agree_with_scikit_image() {
    let ramp = film(|x, y, c| (3.0 * x + 5.0 * y + 7.0 * c) % 17.0 / 17.0);
    for (other, expected_ssim, expected_psnr) in [
        (wave(0.35, 0.3), 0.943_784_237_326_444_3, 24.305_061_165_912_81),
        (ramp, 0.004_744_023_317_336_765, 9.139_738_904_257_547),
        (film(|_, _, _| 0.5), 0.042_953_497_663_233_996, 14.046_254_993_449_443),
    ] {
        assert_relative_eq!(ssim(&wave(0.4, 0.0), &other), expected_ssim, epsilon = 1e-5);
        assert_relative_eq!(psnr(&wave(0.4, 0.0), &other), expected_psnr, epsilon = 1e-4);
    }
}

#[test]
fn equal_images_have_the_cap_and_radiance_is_clipped() {
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
fn an_image_with_a_nan_has_no_psnr_and_no_ssim() {
    let (image, mut damaged) = (wave(0.4, 0.0), wave(0.4, 0.0));
    damaged.pixels[250][1] = f32::NAN;
    assert!(psnr(&image, &damaged).is_nan() && ssim(&image, &damaged).is_nan());
    assert_eq!(mask_iou(&[f32::NAN, 1.0], &[1.0, 1.0]), 0.5);
}

#[test]
fn small_images_have_no_ssim_and_empty_masks_agree() {
    let small = Film::new(10, 30);
    assert!(ssim(&small, &small).is_nan());
    assert_eq!(mask_iou(&[0.0; 3], &[0.4; 3]), 1.0);
    assert_eq!(mask_iou(&[1.0, 0.5, 0.0, 0.0], &[1.0, 0.0, 0.7, 0.0]), 1.0 / 3.0);
}

#[test]
fn pixels_that_are_left_out_do_not_count() {
    let (a, b) = (film(|_, _, _| 0.5), film(|x, _, _| if x < 6.0 { 0.9 } else { 0.6 }));
    let right = psnr_where(&a, &b, (0..480).map(|i| i % 24 >= 6)).unwrap();
    assert_relative_eq!(right, 20.0, epsilon = 1e-4);
    assert_eq!(psnr_where(&a, &b, [false; 480]), None);
    assert!(psnr(&a, &b) < 20.0);
}
