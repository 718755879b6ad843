//! Samples of the Gaussian pixel filter.

use field::Real;
use glam::DVec2;
use random::{Stream, gaussian};
use render::{Pixel, Sample, pixel_samples};

use crate::estimator::FILTER_DEVIATION;

/// `spp` samples per pixel, distributed as the Gaussian filter k of the pixel, and ∇_u ln k at
/// each, per pixel.
pub fn gaussian_samples<R: Real>(
    pixels: &[Pixel],
    spp: u32,
    stream: Stream,
) -> (Vec<Sample>, Vec<[R; 2]>) {
    let mut du = Vec::with_capacity(pixels.len() * spp as usize);
    let mut samples = pixel_samples(pixels.iter().copied(), &(0..spp), stream);
    for sample in &mut samples {
        let corner = sample.u.floor();
        let off = DVec2::from(gaussian((sample.u - corner).into())) * FILTER_DEVIATION;
        sample.u = corner + 0.5 + off;
        du.push((-off / (FILTER_DEVIATION * FILTER_DEVIATION)).to_array().map(R::of));
    }
    (samples, du)
}
