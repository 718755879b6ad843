//! The total loss of an iteration, and its gradient: one page from drawn pixels to the sums over
//! parameters.

use estimate::record::{CameraAdjoints, Pass};
use estimate::{Estimator, SampleCounts};
use glam::DVec3;
use lanes::LANES;
use multiview::stereo::Guide;
use rayon::prelude::*;
use render::{CameraAdjoint, InvalidField};

use crate::carve::pushes_of;
use crate::drawn::{Drawn, PART, PARTS, ROUND, portion};
use crate::objective::{Objective, Surface};
use crate::reversed::Reversed;
use crate::stats::BatchStats;
use crate::sums::PartSums;
use crate::workspace::{Stage, Workspace};
use crate::{sharp, soft};

/// The gradient of the mean loss of the drawn pixels.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// By the parameters of the field, then by those of the radiance head, then by those of a
    /// trained background.
    pub parameters: Vec<f32>,
    /// By the cameras, if they are wanted; else empty.
    pub cameras: Vec<CameraAdjoint>,
    /// By the natural logarithms of the gains, if these are fitted; else empty.
    pub gains: Vec<DVec3>,
    /// The sums over the pixels.
    pub stats: BatchStats,
}

/// The gradient of the mean loss of the drawn pixels.
///
/// The pixels pass through these stages; each is a value that the next one takes:
///
/// | stage | content |
/// | --- | --- |
/// | drawn | pixels, in parts with random numbers of their own |
/// | traced | rays through the pixels, with their hits or with the opacity along them |
/// | shaded | the radiance of each pixel |
/// | compared | the loss of each pixel, and its derivative by the radiance |
/// | reversed | coefficients of f and ∇f at points, and sums by the other parameters |
/// | added | the gradient by all parameters |
///
/// The bits do not depend on the number of threads. Values at a point do not depend on the points
/// beside it, so the groups of rays that are traced together follow the number of threads. Random
/// numbers and sums are those of 16 parts of a round, for any number of threads.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray. If it does so along several, the number of
/// threads may decide which of them the error names.
pub fn gradient(objective: &Objective<'_>, work: &mut Workspace) -> Result<Gradient, InvalidField> {
    let mut added = Gradient::zero(objective, work);
    for (round, draws) in objective.draws.chunks(ROUND).enumerate() {
        let stream = objective.stream.named(PART).at(round as u64);
        let round = Objective { draws, stream, ..*objective };
        let sums = work.take(&round);

        let reversed = match round.surface {
            Surface::Soft { sharpness, depths } => {
                of_soft_surface(&round, (sharpness, depths), sums, work)?
            }
            Surface::Sharp { estimator, counts, pass } => {
                of_sharp_surface(&round, (estimator, counts, pass), sums, work)?
            }
        };
        added.add(reversed, work);
    }
    Ok(added)
}

/// All stages of a round with a soft surface of this sharpness; `depths` guide it. `sums` are zero,
/// and become those of the parts.
fn of_soft_surface(
    round: &Objective<'_>,
    (sharpness, depths): (f32, Option<Guide<'_>>),
    sums: Vec<PartSums>,
    work: &Workspace,
) -> Result<Vec<Reversed>, InvalidField> {
    let uncarved = |drawn, sums| {
        let traced = soft::Traced::new(drawn, sharpness)?;
        let shaded = traced.shade();
        let compared = shaded.compare(depths);
        Ok(compared.reverse(sums))
    };
    let parts = Drawn::parts(round).into_par_iter().zip(sums);
    let task = |(drawn, sums)| work.run(Stage::Soft, || uncarved(drawn, sums));
    let compared = in_order(parts.map(task))?;

    // The pushes need the losses of all pixels of the round.
    let pushes = pushes_of(round, compared.iter().flat_map(soft::Uncarved::losses));
    let reversed: Vec<Reversed> = compared
        .into_par_iter()
        .map(|part| work.run(Stage::Reverse, || part.carve(&pushes)))
        .collect();
    Ok(backward(round, reversed, work))
}

/// All stages of a round with a sharp surface. `sums` are zero, and become those of the parts.
///
/// The records of pixels that a silhouette may cross take long, and are few. Threads without one
/// reverse the other pixels meanwhile.
fn of_sharp_surface(
    round: &Objective<'_>,
    (estimator, counts, pass): (&dyn Estimator<f32>, SampleCounts, Pass<f32>),
    sums: Vec<PartSums>,
    work: &Workspace,
) -> Result<Vec<Reversed>, InvalidField> {
    let (tasks, count) = (work.tasks(), round.draws.len());
    let one_each = |task| Ok(sharp::Shaded::new(round, portion(count, task, tasks))?.compare());
    let compared = share(tasks).map(|task| work.run(Stage::Trace, || one_each(task)));
    let compared = sharp::Compared::joined(in_order(compared)?);
    let (draws, losses) = (compared.crossed_draws(), compared.mean_losses());
    let typical = losses.typical();
    let patches = round.patches.map(|patches| patches.after_fall(losses.of_object()));
    let round = &Objective { patches, ..*round };
    let pushes = pushes_of(round, compared.photometric().into_iter());

    // Records of a warp depend on the pixels beside: these are those of a part.
    let is_by_pixel = estimator.is_by_pixel();
    let tasks = if is_by_pixel { tasks } else { PARTS };
    let crossed = |task| {
        let own = &draws[portion(draws.len(), task, tasks)];
        sharp::Compared::crossed(round, estimator, counts, own)
    };
    let crossed = || {
        let records = share(tasks).map(|task| work.run(Stage::Record, || crossed(task)));
        let records = in_order(records)?;
        Ok(if is_by_pixel { sharp::Compared::joined(records).deal() } else { records })
    };
    let smooth = || {
        let parts = work.run(Stage::Deal, || sharp::SmoothPart::parts(round, compared));
        let parts = parts.into_par_iter().zip(sums);
        let reverse = |(part, sums): (sharp::SmoothPart<'_>, PartSums)| {
            work.run(Stage::Reverse, || part.reverse(pass, sums, &pushes))
        };
        backward(round, parts.map(reverse).collect(), work)
    };
    let (crossed, mut reversed) = rayon::join(crossed, smooth);

    reversed.par_iter_mut().zip(crossed?).for_each(|(out, part)| {
        work.run(Stage::ReverseRecord, || part.reverse_crossed(round, (typical, pass), out));
    });
    Ok(backward(round, reversed, work))
}

/// Adds the gradient by the field's parameters of all coefficients. Each part has the same number
/// of points, in whole blocks.
fn backward(round: &Objective<'_>, mut reversed: Vec<Reversed>, work: &Workspace) -> Vec<Reversed> {
    let (mut x, mut alpha, mut c) = (Vec::new(), Vec::new(), Vec::new());
    for part in &mut reversed {
        let points = std::mem::take(&mut part.points).into_iter();
        let of_records = std::mem::take(&mut part.records.points).into_iter();
        let all = points.chain(of_records.map(|own| own.point));
        for point in all.filter(|point| !point.is_zero()) {
            x.push(point.x);
            alpha.push(point.alpha);
            c.push(point.c);
        }
    }

    let size = x.len().div_ceil(reversed.len()).next_multiple_of(LANES).max(LANES);
    let points = x.par_chunks(size).zip(alpha.par_chunks(size)).zip(c.par_chunks(size));
    reversed.par_iter_mut().zip(points).for_each(|(part, ((x, alpha), c))| {
        let (field, sum) = (round.scene.field, &mut part.sums.field);
        work.run(Stage::Backward, || field.add_parameter_vjp(x, alpha, c, sum));
    });
    reversed
}

impl Gradient {
    /// The sums of no pixel.
    fn zero(objective: &Objective<'_>, work: &mut Workspace) -> Self {
        let cameras = if objective.wanted.cameras { objective.scene.cameras.len() } else { 0 };
        Gradient {
            parameters: work.zeros(objective),
            cameras: vec![CameraAdjoint::default(); cameras],
            gains: vec![DVec3::ZERO; objective.targets.gains.len()],
            stats: BatchStats::default(),
        }
    }

    /// Adds the sums of all parts of a round.
    fn add(&mut self, reversed: Vec<Reversed>, work: &mut Workspace) {
        let mut sums = Vec::with_capacity(reversed.len());
        for part in reversed {
            self.stats.add(&part.stats);
            self.gains.iter_mut().zip(part.gains).for_each(|(sum, part)| *sum += part);
            let of_part = |cameras: CameraAdjoints| cameras.sums;
            let cameras = part.records.cameras.into_iter().flat_map(of_part);
            self.cameras.iter_mut().zip(cameras).for_each(|(sum, part)| *sum += part);
            sums.push(part.sums);
        }
        work.add_to(&mut self.parameters, sums);
    }
}

/// Tasks, each of which a thread takes alone.
fn share(tasks: usize) -> impl IndexedParallelIterator<Item = usize> {
    (0..tasks).into_par_iter().with_max_len(1)
}

/// All results, or the first error, in order.
fn in_order<T: Send>(
    results: impl IndexedParallelIterator<Item = Result<T, InvalidField>>,
) -> Result<Vec<T>, InvalidField> {
    results.collect::<Vec<_>>().into_iter().collect()
}

#[cfg(test)]
mod tests;
