//! The gradient of one iteration: the photometric term and the eikonal term over a batch of
//! pixels.

use estimate::record::{Adjoints, PointAdjoint};
use glam::DVec3;
use rayon::prelude::*;
use render::{CameraAdjoint, InvalidField};
use stereo::pushes;

use crate::batch::{Batch, BatchStats};
use crate::part::Part;
use crate::sharp::{record_edges, trace};
use crate::sums::{Stage, Workspace};

/// Points that a network takes at once, with single precision.
const BLOCK: usize = 16;

/// The number of parts of a batch: 16 threads can share it.
pub(crate) const PARTS: usize = 16;

/// The gradient of the mean loss of a batch.
pub struct Gradient {
    /// By the parameters of the field, then by those of the radiance head, then by those of a
    /// trained background.
    pub parameters: Vec<f32>,
    /// By the cameras, if they are refined; else empty.
    pub cameras: Vec<CameraAdjoint>,
    /// By the natural logarithms of the gains, if these are fitted; else empty.
    pub gains: Vec<DVec3>,
    /// The sums over the batch.
    pub stats: BatchStats,
}

/// The gradient of the mean loss of the batch.
///
/// The bits do not depend on the number of threads. Values at a point do not depend on the points
/// beside it, so threads trace rays together as it suits them. Random numbers and sums are those of
/// 16 parts of the batch, whatever the number of threads.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub fn gradient(batch: &Batch<'_>, work: &mut Workspace) -> Result<Gradient, InvalidField> {
    let sums = work.take(PARTS, batch);
    let mut parts: Vec<Part<'_>> =
        sums.into_iter().enumerate().map(|(n, sums)| Part::new(batch, n, sums)).collect();
    if let Some(sharpness) = batch.sharpness {
        let soft = |part: &mut Part<'_>| work.run(Stage::Soft, || part.add_soft_pixels(sharpness));
        in_order(parts.par_iter_mut().map(soft))?;
    } else {
        trace(batch, work, &mut parts)?;
    }
    let pushes = pushes_of(batch, &parts);
    let together = PARTS.div_ceil(work.tasks());
    let finish = |parts: &mut [Part<'_>]| {
        if batch.sharpness.is_none() {
            record_edges(batch, parts)?;
        }
        parts.iter_mut().for_each(|part| part.finish(&pushes));
        Ok(())
    };
    let groups = parts.par_chunks_mut(together);
    in_order(groups.map(|parts| work.run(Stage::Reverse, || finish(parts))))?;
    backward(batch, &mut parts, work);
    Ok(sum(batch, parts, work))
}

/// Adds the gradient by the field's parameters of all coefficients. Each part has the same number
/// of points, in whole blocks.
fn backward(batch: &Batch<'_>, parts: &mut [Part<'_>], work: &Workspace) {
    let mut points: Vec<PointAdjoint<f32>> = Vec::new();
    for part in &mut *parts {
        points.extend(part.adjoints.points.drain(..).filter(|point| !point.is_zero()));
    }
    let size = points.len().div_ceil(parts.len()).next_multiple_of(BLOCK).max(BLOCK);
    parts.par_iter_mut().zip(points.par_chunks(size)).for_each(|(part, points)| {
        let adjoints = Adjoints { points: points.to_vec(), cameras: None };
        let sum = &mut part.sums.field;
        work.run(Stage::Backward, || adjoints.add_backward(batch.scene.field, sum));
    });
}

/// All results, or the first error, in order.
pub(crate) fn in_order<T: Send>(
    results: impl IndexedParallelIterator<Item = Result<T, InvalidField>>,
) -> Result<Vec<T>, InvalidField> {
    results.collect::<Vec<_>>().into_iter().collect()
}

/// The push of each pixel of the batch, if surfaces that photographs contradict go back; else
/// empty. See [`pushes`].
fn pushes_of(batch: &Batch<'_>, parts: &[Part<'_>]) -> Vec<f32> {
    if !batch.carves || batch.depths.is_none() {
        return Vec::new();
    }
    let losses: Vec<Option<f32>> =
        parts.iter().flat_map(|part| part.losses.iter().copied()).collect();
    pushes(losses.into_iter().zip(batch.pixels.iter().map(|p| f32::from(p.count))))
}

/// The sum over all parts.
fn sum(batch: &Batch<'_>, parts: Vec<Part<'_>>, work: &mut Workspace) -> Gradient {
    let mut stats = BatchStats::default();
    let count = if batch.refines_cameras { batch.scene.cameras.len() } else { 0 };
    let mut cameras = vec![CameraAdjoint::default(); count];
    let mut gains = vec![DVec3::ZERO; batch.gains.len()];
    let mut sums = Vec::with_capacity(parts.len());
    for part in parts {
        stats.add(&part.stats);
        gains.iter_mut().zip(part.gains).for_each(|(sum, part)| *sum += part);
        let of_part = part.adjoints.cameras.into_iter().flat_map(|cameras| cameras.sums);
        cameras.iter_mut().zip(of_part).for_each(|(sum, part)| *sum += part);
        sums.push(part.sums);
    }
    Gradient { parameters: work.total(sums), cameras, gains, stats }
}
