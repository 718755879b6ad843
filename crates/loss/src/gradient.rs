//! The gradient of one iteration: the photometric term and the eikonal term over a batch of
//! pixels.

use std::ops::Range;

use estimate::record::Adjoints;
use glam::DVec3;
use lanes::LANES;
use multiview::stereo::pushes;
use random::{Purpose, Stream};
use rayon::prelude::*;
use render::{CameraAdjoint, InvalidField};

use crate::batch::{Batch, BatchStats};
use crate::part::Part;
use crate::sharp::trace;
use crate::sums::{Stage, Workspace};

/// The most pixels of a batch that are in memory together.
pub const ROUND: usize = 4096;

/// The number of parts of a round: 16 threads can share it.
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
/// beside it, so the groups of rays that are traced together follow the number of threads. Random
/// numbers and sums are those of 16 parts of a round, for any number of threads.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray. If it does so along several, the number of
/// threads may decide which of them the error names.
pub fn gradient(batch: &Batch<'_>, work: &mut Workspace) -> Result<Gradient, InvalidField> {
    let cameras = if batch.refines_cameras { batch.scene.cameras.len() } else { 0 };
    let mut sum = Gradient {
        parameters: work.zeros(batch),
        cameras: vec![CameraAdjoint::default(); cameras],
        gains: vec![DVec3::ZERO; batch.gains.len()],
        stats: BatchStats::default(),
    };
    for (round, pixels) in batch.pixels.chunks(ROUND).enumerate() {
        let seed = Stream::new(batch.seed, Purpose::Part).at(round as u64).bits();
        add_round(&Batch { pixels, seed, ..*batch }, work, &mut sum)?;
    }
    Ok(sum)
}

/// Adds the gradient of the pixels of a round.
fn add_round(
    batch: &Batch<'_>,
    work: &mut Workspace,
    sum: &mut Gradient,
) -> Result<(), InvalidField> {
    let sums = work.take(batch);
    let mut parts: Vec<Part<'_>> =
        sums.into_iter().enumerate().map(|(n, sums)| Part::new(batch, n, sums)).collect();
    if let Some(sharpness) = batch.sharpness {
        let soft = |part: &mut Part<'_>| work.run(Stage::Soft, || part.add_soft_pixels(sharpness));
        in_order(parts.par_iter_mut().map(soft))?;
    } else {
        trace(batch, work, &mut parts)?;
    }
    let pushes = pushes_of(batch, &parts);
    parts.par_iter_mut().for_each(|part| work.run(Stage::Reverse, || part.finish(&pushes)));
    backward(batch, &mut parts, work);
    let mut sums = Vec::with_capacity(parts.len());
    for part in parts {
        sum.stats.add(&part.stats);
        sum.gains.iter_mut().zip(part.gains).for_each(|(sum, part)| *sum += part);
        let cameras = part.adjoints.cameras.into_iter().flat_map(|cameras| cameras.sums);
        sum.cameras.iter_mut().zip(cameras).for_each(|(sum, part)| *sum += part);
        sums.push(part.sums);
    }
    work.add_to(&mut sum.parameters, sums);
    Ok(())
}

/// The share of a task in `count` things.
pub(crate) fn share(count: usize, task: usize, tasks: usize) -> Range<usize> {
    task * count / tasks..(task + 1) * count / tasks
}

/// Adds the gradient by the field's parameters of all coefficients. Each part has the same number
/// of points, in whole blocks.
fn backward(batch: &Batch<'_>, parts: &mut [Part<'_>], work: &Workspace) {
    let mut all = Adjoints::default();
    for part in &mut *parts {
        all.points.append(&mut part.adjoints.points);
    }
    let (x, alpha, c) = all.columns();
    let size = x.len().div_ceil(parts.len()).next_multiple_of(LANES).max(LANES);
    let points = x.par_chunks(size).zip(alpha.par_chunks(size)).zip(c.par_chunks(size));
    parts.par_iter_mut().zip(points).for_each(|(part, ((x, alpha), c))| {
        let (field, sum) = (batch.scene.field, &mut part.sums.field);
        work.run(Stage::Backward, || field.add_parameter_vjp(x, alpha, c, sum));
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
