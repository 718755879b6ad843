//! The total loss of an iteration, and its gradient: one page from drawn pixels to the sums over
//! parameters.

use estimate::record::CameraAdjoints;
use glam::DVec3;
use lanes::LANES;
use rayon::prelude::*;
use render::{CameraAdjoint, InvalidField};

use crate::carve::pushes_of;
use crate::drawn::{Drawn, PART, PARTS, portion};
use crate::objective::{Objective, Surface};
use crate::reversed::Reversed;
use crate::stats::BatchStats;
use crate::sums::PartSums;
use crate::workspace::{Stage, Workspace};
use crate::{sharp, soft};

/// The most pixels that are in memory together.
pub const ROUND: usize = 4096;

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

        let compared = compare(&round, sums, work)?;

        // The pushes need the losses of all pixels of the round.
        let pushes = pushes_of(&round, compared.iter().flat_map(Compared::losses));
        let reversed: Vec<Reversed> = compared
            .into_par_iter()
            .map(|part| work.run(Stage::Reverse, || part.reverse(&pushes)))
            .collect();

        added.add(backward(&round, reversed, work), work);
    }
    Ok(added)
}

/// Traces, shades and compares the pixels of a round. `sums` are zero, and become those of the
/// parts.
fn compare<'a>(
    round: &'a Objective<'a>,
    sums: Vec<PartSums>,
    work: &Workspace,
) -> Result<Vec<Compared<'a>>, InvalidField> {
    match round.surface {
        Surface::Soft { sharpness, depths } => {
            let uncarved = |drawn: Drawn<'a>, sums: PartSums| {
                let traced = soft::Traced::new(drawn, sharpness)?;
                let shaded = traced.shade();
                let compared = shaded.compare(depths);
                Ok(Compared::Soft(Box::new(compared.reverse(sums))))
            };
            let parts = Drawn::parts(round).into_par_iter().zip(sums);
            let task = |(drawn, sums)| work.run(Stage::Soft, || uncarved(drawn, sums));
            in_order(parts.map(task))
        }
        Surface::Sharp { estimator, counts, pass } => {
            let (tasks, count) = (work.tasks(), round.draws.len());
            let smooth = |task| {
                let shaded = sharp::Shaded::new(round, portion(count, task, tasks))?;
                Ok(shaded.compare())
            };
            let compared = share(tasks).map(|task| work.run(Stage::Trace, || smooth(task)));
            let compared = in_order(compared)?.into_iter();
            let mut all = compared.fold(sharp::Compared::default(), sharp::Compared::joined);

            let (draws, typical) = (all.crossed_draws(), all.typical_losses());
            // Records of a warp depend on the pixels beside: these are those of a part.
            let is_by_pixel = estimator.is_by_pixel();
            let tasks = if is_by_pixel { tasks } else { PARTS };
            let crossed = |task| {
                let own = &draws[portion(draws.len(), task, tasks)];
                sharp::Compared::crossed(round, estimator, counts, own)
            };
            let compared = share(tasks).map(|task| work.run(Stage::Record, || crossed(task)));
            let mut edges = in_order(compared)?;
            if is_by_pixel {
                all = std::mem::take(&mut edges).into_iter().fold(all, sharp::Compared::joined);
            }

            let parts = sharp::ComparedPart::parts(round, sums, (all, edges), (typical, pass));
            Ok(parts.into_iter().map(Box::new).map(Compared::Sharp).collect())
        }
    }
}

/// A part of the pixels of a round that were compared with the photographs. A soft part has the
/// adjoints of all terms but carving already.
enum Compared<'a> {
    Soft(Box<soft::Uncarved<'a>>),
    Sharp(Box<sharp::ComparedPart<'a>>),
}

impl Compared<'_> {
    /// The photometric loss of each pixel; `None` for one that a silhouette may cross.
    fn losses(&self) -> Vec<Option<f32>> {
        match self {
            Compared::Soft(part) => part.losses(),
            Compared::Sharp(part) => part.losses(),
        }
    }

    /// The adjoints of all terms.
    fn reverse(self, pushes: &[f32]) -> Reversed {
        match self {
            Compared::Soft(part) => part.carve(pushes),
            Compared::Sharp(part) => part.reverse(pushes),
        }
    }
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
