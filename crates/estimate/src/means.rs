//! Means over the samples of pixels, and samples of the Gaussian pixel filter.

use field::{Real, Vector3};
use glam::DVec2;
use random::gaussian;
use render::{Pixel, Primary, Sample, pixel_samples};

use crate::estimator::FILTER_DEVIATION;

/// The mean radiance of every pixel, from `spp` samples per pixel in the order of the pixels.
pub(crate) fn pixel_means<R: Real>(primary: &Primary<R>, spp: u32) -> Vec<R::Vec3> {
    let share = R::one() / R::of(f64::from(spp));
    let sum = |own: &[render::TracedSample<R>]| {
        own.iter().fold(R::Vec3::zero(), |sum, s| sum + s.radiance) * share
    };
    primary.samples.chunks(spp as usize).map(sum).collect()
}

/// `spp` samples per pixel, distributed as the Gaussian filter k of the pixel, and ∇_u ln k at
/// each, per pixel.
pub(crate) fn gaussian_samples<R: Real>(
    pixels: &[Pixel],
    spp: u32,
    seed: u64,
) -> (Vec<Sample>, Vec<[R; 2]>) {
    let mut du = Vec::with_capacity(pixels.len() * spp as usize);
    let mut samples = pixel_samples(pixels.iter().copied(), &(0..spp), seed);
    for sample in &mut samples {
        let corner = sample.u.floor();
        let off = DVec2::from(gaussian((sample.u - corner).into())) * FILTER_DEVIATION;
        sample.u = corner + 0.5 + off;
        du.push((-off / (FILTER_DEVIATION * FILTER_DEVIATION)).to_array().map(R::of));
    }
    (samples, du)
}
