//! Images: box-filtered radiance.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use field::{Real, Vector3};
use film::Film;
use rayon::prelude::*;

use crate::invalid::InvalidField;
use crate::sample::{Pixel, pixel_samples};
use crate::scene::Scene;

/// Samples per chunk, about: enough to fill the field's blocks of points, few enough to stay in the
/// caches and to balance threads.
const CHUNK: usize = 1024;

/// A rendered view.
#[derive(Clone, Debug)]
pub struct Render {
    /// The mean radiance of every pixel, linear RGB.
    pub film: Film,
    /// For every pixel, row-major, the fraction of its samples that hit, 0 to 1.
    pub coverage: Vec<f32>,
}

/// Renders the image of camera number `camera` with a box filter: the value of a pixel is the mean
/// of `spp` samples in its unit square.
///
/// The same seed gives the same bits on any number of threads.
/// `progress` gets the fraction that is done; several threads call it.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
///
/// # Panics
/// If `spp` is 0 or the scene has no camera of this number.
pub fn render<R: Real>(
    scene: &Scene<'_, R>,
    camera: usize,
    spp: u32,
    seed: u64,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Render, InvalidField> {
    let scene = &scene.clipped_to_solid();
    let (width, height) = (scene.cameras[camera].width, scene.cameras[camera].height);
    let count = width as usize * height as usize;
    let done = AtomicUsize::new(0);
    let size = (CHUNK / spp as usize).max(1);
    let chunks: Vec<Vec<([f32; 3], f32)>> = (0..count.div_ceil(size))
        .into_par_iter()
        // A program that stops a command unwinds from `progress`.
        .panic_fuse()
        .map(|chunk| {
            let pixels = chunk * size..((chunk + 1) * size).min(count);
            let result = render_pixels(scene, camera, pixels, spp, seed);
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            progress((done * size) as f64 / count as f64);
            result
        })
        .collect::<Result<_, _>>()?;
    let (pixels, coverage) = chunks.into_iter().flatten().unzip();
    Ok(Render { film: Film { width, height, pixels }, coverage })
}

/// Mean radiance and coverage of the pixels with these row-major numbers.
fn render_pixels<R: Real>(
    scene: &Scene<'_, R>,
    camera: usize,
    pixels: Range<usize>,
    spp: u32,
    seed: u64,
) -> Result<Vec<([f32; 3], f32)>, InvalidField> {
    let width = scene.cameras[camera].width as usize;
    let pixels = pixels.map(|p| Pixel { camera, x: (p % width) as u32, y: (p / width) as u32 });
    let primary = scene.primary(&pixel_samples(pixels, &(0..spp), seed))?;
    let per_pixel = primary.samples.chunks(spp as usize);
    let mut hits = vec![0u32; per_pixel.len()];
    primary.hits.iter().for_each(|hit| hits[hit.sample / spp as usize] += 1);
    Ok(per_pixel
        .zip(hits)
        .map(|(samples, hits)| {
            let sum = samples.iter().fold(R::Vec3::zero(), |sum, s| sum + s.radiance);
            let mean = sum.to_array().map(|c| c.to_double() / f64::from(spp));
            (mean.map(|c| c as f32), hits as f32 / spp as f32)
        })
        .collect())
}
