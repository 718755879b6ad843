//! Images: box-filtered radiance, sample by sample.

use std::ops::Range;

use field::{Real, Vector3};
use glam::DVec2;
use rayon::prelude::*;
use trace::{Intersection, Outcome};

use super::{Pixel, Sample, Setup};
use crate::InvalidField;
use film::Film;
use random::{mix, sobol};

/// Samples a chunk: enough to fill the field's blocks, few enough to stay in the caches and to
/// balance threads.
const CHUNK: usize = 1024;

/// A rendered view.
#[derive(Clone, Debug)]
pub struct Render {
    /// Linear radiance.
    pub film: Film,
    /// The fraction of every pixel's samples that hit, row-major.
    pub coverage: Vec<f32>,
}

/// Samples of every pixel, in order: those of the numbers `range` of a Sobol point set in its unit
/// square, scrambled by `seed` and the pixel.
pub(crate) fn pixel_samples(
    pixels: impl ExactSizeIterator<Item = Pixel>,
    range: &Range<u32>,
    seed: u64,
) -> Vec<Sample> {
    let mut samples = Vec::with_capacity(pixels.len() * range.len());
    for Pixel { camera, x, y } in pixels {
        let stream = mix(seed, u64::from(y) << 32 | u64::from(x));
        samples.extend(range.clone().map(|i| {
            let [a, b] = sobol(i, stream);
            Sample { camera, u: DVec2::new(f64::from(x) + a, f64::from(y) + b) }
        }));
    }
    samples
}

/// The error for a NaN met at one of `samples`, if there was one.
pub fn check_valid<R: Real>(
    setup: &Setup<'_, R>,
    samples: &[Sample],
    invalid: Option<usize>,
) -> Result<(), InvalidField> {
    match invalid {
        None => Ok(()),
        Some(i) => {
            let Sample { camera, u } = samples[i];
            let (eye, direction) = (setup.cameras[camera].eye, setup.cameras[camera].direction(u));
            Err(InvalidField { camera, u, eye, direction })
        }
    }
}

/// The first ray on which a NaN or an infinity was met.
pub(crate) fn first_invalid<R: Real>(found: &[Option<Intersection<R>>]) -> Option<usize> {
    found.iter().position(|f| f.is_some_and(|f| f.outcome == Outcome::Invalid))
}

/// Renders camera `camera` of the setup with `spp` samples a pixel. `progress` is told the fraction
/// done.
///
/// # Errors
/// If the field gives a NaN or an infinity.
pub fn render<R: Real>(
    setup: &Setup<'_, R>,
    camera: usize,
    spp: u32,
    seed: u64,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Render, InvalidField> {
    let setup = &setup.hugged();
    let (width, height) = (setup.cameras[camera].width, setup.cameras[camera].height);
    let count = width as usize * height as usize;
    let done = std::sync::atomic::AtomicUsize::new(0);
    let size = (CHUNK / spp as usize).max(1);
    let chunks: Vec<Vec<([f32; 3], f32)>> = (0..count.div_ceil(size))
        .into_par_iter()
        .map(|chunk| {
            let pixels = chunk * size..((chunk + 1) * size).min(count);
            let result = render_pixels(setup, camera, pixels, spp, seed);
            let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            progress((done * size) as f64 / count as f64);
            result
        })
        .collect::<Result<_, _>>()?;
    let (pixels, coverage) = chunks.into_iter().flatten().unzip();
    Ok(Render { film: Film { width, height, pixels }, coverage })
}

fn render_pixels<R: Real>(
    setup: &Setup<'_, R>,
    camera: usize,
    pixels: Range<usize>,
    spp: u32,
    seed: u64,
) -> Result<Vec<([f32; 3], f32)>, InvalidField> {
    let width = setup.cameras[camera].width as usize;
    let pixels = pixels.map(|p| Pixel { camera, x: (p % width) as u32, y: (p / width) as u32 });
    let samples = pixel_samples(pixels, &(0..spp), seed);
    let primary = setup.primary(&samples);
    check_valid(setup, &samples, primary.invalid)?;
    let mut hit = vec![0.0f32; samples.len()];
    primary.hits.iter().for_each(|&i| hit[i] = 1.0);
    let per_pixel = primary.radiance.chunks(spp as usize).zip(hit.chunks(spp as usize));
    Ok(per_pixel
        .map(|(radiance, hit)| {
            let sum = radiance.iter().fold(R::Vec3::zero(), |sum, l| sum + *l);
            let mean = sum.to_array().map(|c| c.to_double() / f64::from(spp));
            (mean.map(|c| c as f32), hit.iter().sum::<f32>() / spp as f32)
        })
        .collect())
}
