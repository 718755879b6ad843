//! The PSNR of a fit on a sample of the pixels, the same for training and for held-out views.

use std::ops::Range;

use dataset::View;
use field::Sphere;
use film::Film;
use glam::DVec2;
use metrics::psnr;
use render::{InvalidField, Sample, Scene};

/// The largest number of views whose pixels are rendered.
const VIEWS: usize = 8;

/// Pixels of each of these views.
const PIXELS: usize = 1024;

/// The fractional part of the golden ratio. Its multiples, modulo 1, are spread evenly.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// The PSNR in dB over pixels whose rays meet the bounding sphere: 1024 pixels in each of at most
/// eight views, evenly spread, one ray through the centre of each.
///
/// `views` have the cameras `numbers` of `scene`. With `only_hits`, pixels that show the background
/// do not count: a trained one is less sharp in held-out views. `None` if there is no such pixel.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub fn sampled_psnr(
    scene: &Scene<'_, f32>,
    sphere: &Sphere<f64>,
    views: &[View],
    numbers: Range<usize>,
    only_hits: bool,
) -> Result<Option<f64>, InvalidField> {
    let (mut shown, mut rendered) = (Vec::new(), Vec::new());
    let step = views.len().div_ceil(VIEWS).max(1);
    for (view, camera) in views.iter().zip(numbers).step_by(step) {
        let pixels = sampled_pixels(view, sphere);
        let center = |[x, y]: &[u32; 2]| DVec2::new(f64::from(*x) + 0.5, f64::from(*y) + 0.5);
        let samples: Vec<Sample> =
            pixels.iter().map(|pixel| Sample { camera, u: center(pixel) }).collect();
        let primary = scene.primary(&samples)?;
        let hit = primary.hit_mask();
        for (i, (rgb, [x, y])) in primary.pixel_means(1).iter().zip(&pixels).enumerate() {
            if hit[i] || !only_hits {
                rendered.push(rgb.to_array());
                shown.push(view.image.at(*x, *y));
            }
        }
    }
    let row = |pixels: Vec<[f32; 3]>| Film { width: pixels.len() as u32, height: 1, pixels };
    Ok((!shown.is_empty()).then(|| psnr(&row(rendered), &row(shown))))
}

/// Used pixels of a view whose rays meet the sphere.
fn sampled_pixels(view: &View, sphere: &Sphere<f64>) -> Vec<[u32; 2]> {
    let (width, height) = (view.image.width, view.image.height);
    let meets = |[x, y]: &[u32; 2]| {
        let u = DVec2::new(f64::from(*x) + 0.5, f64::from(*y) + 0.5);
        view.is_used((y * width + x) as usize)
            && sphere.clip(view.camera.eye, view.camera.direction(u)).is_some()
    };
    let all: Vec<[u32; 2]> =
        (0..height).flat_map(|y| (0..width).map(move |x| [x, y])).filter(meets).collect();
    if all.len() <= PIXELS {
        return all;
    }
    let place = |i: usize| ((i as f64 + 0.5) * GOLDEN).fract() * all.len() as f64;
    (0..PIXELS).map(|i| all[place(i) as usize]).collect()
}
