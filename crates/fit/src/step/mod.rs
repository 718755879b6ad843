//! The gradient of one iteration: the photometric term and the eikonal term over a batch of
//! pixels.

mod carve;
mod chunk;
mod eikonal;
mod photometric;
mod soft;

use estimate::record::ordered_sum;
use estimate::{SilhouetteMargin, near_silhouettes};
use glam::DVec3;
use random::{Purpose, Stream};
use render::{CameraAdjoint, InvalidField};

pub(crate) use chunk::{Batch, BatchStats};
use chunk::{Chunk, pixels_of};
use photometry::Pixel;

/// The largest number of pixels of a chunk. Chunks of 256 pixels were a tenth slower on two
/// threads: they fill the field's blocks of points less.
const CHUNK: usize = 512;

/// The least number of chunks of an iteration: two threads share it equally.
const CHUNKS: usize = 2;

/// The gradient of the mean loss of a batch.
pub(crate) struct Gradient {
    /// By the parameters of the field, then by those of the radiance head, then by those of a
    /// trained background.
    pub(crate) parameters: Vec<f32>,
    /// By the cameras, if they are refined; else empty.
    pub(crate) cameras: Vec<CameraAdjoint>,
    /// By the natural logarithms of the gains, if these are fitted; else empty.
    pub(crate) gains: Vec<DVec3>,
    /// The sums over the batch.
    pub(crate) stats: BatchStats,
}

/// The gradient of the mean loss of the batch.
///
/// The bits do not depend on the number of threads.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub(crate) fn gradient(batch: &Batch<'_>) -> Result<Gradient, InvalidField> {
    let field = batch.scene.field.parameter_count();
    let shader = batch.scene.shader.parameter_count();
    let background =
        if batch.trains_background { batch.scene.background.parameter_count() } else { 0 };
    let count = batch.pixels.len();
    let chunks = count.div_ceil(CHUNK).max(CHUNKS);
    let size = count.div_ceil(chunks);
    let (parameters, parts) =
        ordered_sum(chunks, field + shader + background, |number, sum: &mut [f32]| {
            let pixels =
                &batch.pixels[(number * size).min(count)..((number + 1) * size).min(count)];
            let (field_sum, others) = sum.split_at_mut(field);
            let (shader_sum, background_sum) = others.split_at_mut(shader);
            let seed = Stream::new(batch.seed, Purpose::Chunk).at(number as u64).bits();
            let mut chunk = Chunk::new(batch, pixels, seed);
            add_terms(&mut chunk, shader_sum, background_sum)?;
            let cameras = chunk.adjoints.cameras.take();
            chunk.adjoints.backward(batch.scene.field, field_sum);
            Ok((chunk.stats, cameras, chunk.gains))
        })?;
    let mut stats = BatchStats::default();
    let count = if batch.refines_cameras { batch.scene.cameras.len() } else { 0 };
    let mut cameras = vec![CameraAdjoint::default(); count];
    let mut gains = vec![DVec3::ZERO; batch.gains.len()];
    for (part, of_part, gains_of_part) in parts {
        stats.add(&part);
        gains.iter_mut().zip(gains_of_part).for_each(|(sum, part)| *sum += part);
        let sums = of_part.into_iter().flat_map(|cameras| cameras.sums);
        cameras.iter_mut().zip(sums).for_each(|(sum, part)| *sum += part);
    }
    Ok(Gradient { parameters, cameras, gains, stats })
}

/// Adds all terms of a chunk: coefficients of f and ∇f to the chunk, the adjoint of the shader's
/// parameters to `shader`, and that of a trained background's to `background`.
fn add_terms(
    chunk: &mut Chunk<'_>,
    shader: &mut [f32],
    background: &mut [f32],
) -> Result<(), InvalidField> {
    if let Some(sharpness) = chunk.batch.sharpness {
        return chunk.add_soft_pixels(sharpness, shader, background);
    }
    let primary = chunk.batch.scene.primary(&chunk.samples())?;
    chunk.stats.rays += primary.samples.len() as u64;
    chunk.stats.pixels += pixels_of(chunk.pixels);
    let crossed = near_silhouettes(&chunk.batch.scene, &primary, SilhouetteMargin::LARGE);
    chunk.add_eikonal(&chunk.hit_points(&primary));
    let typical = chunk.add_smooth_pixels(primary, &crossed, shader, background);
    let edge: Vec<Pixel> =
        chunk.pixels.iter().zip(&crossed).filter(|(_, c)| **c).map(|(p, _)| *p).collect();
    chunk.add_silhouette_pixels(&edge, typical, shader, background)
}

#[cfg(test)]
mod gradient_tests;
