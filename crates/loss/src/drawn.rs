//! The first stage of an iteration: drawn pixels, in parts that threads share.

use std::ops::Range;

use glam::{DVec2, Vec3};
use random::{Name, Stream};
use rayon::prelude::*;
use render::Sample;

use crate::objective::Objective;
use crate::photometry::Draw;

/// The most pixels that are in memory together.
pub const ROUND: usize = 4096;

/// The number of parts of a round: 16 threads can share it.
pub(crate) const PARTS: usize = 16;

/// Draws whose cost a thread computes, at least.
const COSTS: usize = 64;

/// The rounds of an iteration, and then the parts of a round.
pub(crate) const PART: Name = Name::new("rounds and parts of an iteration", 14);
const FIT_SAMPLES: Name = Name::new("position of a fit's sample in its pixel", 15);

/// A part of the pixels of a round, with random numbers of its own.
#[derive(Clone, Copy)]
pub(crate) struct Drawn<'a> {
    pub(crate) objective: &'a Objective<'a>,
    /// The number of the first pixel among the draws of the round.
    pub(crate) first: usize,
    pub(crate) draws: &'a [Draw],
    pub(crate) stream: Stream,
}

impl<'a> Drawn<'a> {
    /// The pixels of a round in [`PARTS`] parts of about the same size.
    pub(crate) fn parts(round: &'a Objective<'a>) -> Vec<Self> {
        let part = |number: usize| {
            let place = portion(round.draws.len(), number, PARTS);
            let stream = round.stream.named(PART).at(number as u64);
            Drawn { objective: round, first: place.start, draws: &round.draws[place], stream }
        };
        (0..PARTS).map(part).collect()
    }

    /// The same part with these pixels of the round.
    pub(crate) fn with(self, place: Range<usize>) -> Self {
        Drawn { first: place.start, draws: &self.objective.draws[place], ..self }
    }

    /// One uniform random sample in every pixel.
    pub(crate) fn samples(&self) -> Vec<Sample> {
        let numbers = self.first..self.first + self.draws.len();
        numbers.map(|number| self.objective.sample(number)).collect()
    }
}

impl Objective<'_> {
    /// The weight of one pixel in the mean loss.
    pub(crate) fn pixel_weight(&self) -> f32 {
        1.0 / self.pixel_count
    }

    /// A uniform random sample in a pixel, which has this number among the draws.
    pub(crate) fn sample(&self, number: usize) -> Sample {
        let stream = self.stream.named(FIT_SAMPLES).at(number as u64);
        let draw = &self.draws[number];
        let at = |corner: u16, axis: u64| f64::from(corner) + stream.at(axis).unit();
        Sample { camera: draw.view as usize, u: DVec2::new(at(draw.x, 0), at(draw.y, 1)) }
    }
}

/// A point of the surface that a part of the pixels sees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NearPoint {
    /// The number of its pixel in the part.
    pub(crate) pixel: usize,
    /// The point, in world units.
    pub(crate) x: Vec3,
    /// The number of pixels that it stands for.
    pub(crate) weight: f32,
}

/// The draws in an order in which the parts of each round take about as long. `cost` is in
/// proportion to the time of a draw.
pub fn balanced(draws: &[Draw], cost: impl Fn(&Draw) -> f64 + Send + Sync) -> Vec<Draw> {
    let costs: Vec<f64> = draws.par_iter().with_min_len(COSTS).map(cost).collect();
    let of_round = |(draws, costs): (&[Draw], &[f64])| {
        let mut order: Vec<usize> = (0..draws.len()).collect();
        order.sort_by(|a, b| costs[*b].total_cmp(&costs[*a]));
        let dealt = |part| order.iter().skip(part).step_by(PARTS);
        (0..PARTS).flat_map(dealt).map(|place| draws[*place]).collect::<Vec<Draw>>()
    };
    draws.chunks(ROUND).zip(costs.chunks(ROUND)).flat_map(of_round).collect()
}

/// One of `every` items, from a random first one.
pub(crate) fn one_of<T>(
    every: usize,
    items: impl Iterator<Item = T>,
    stream: Stream,
) -> impl Iterator<Item = T> {
    items.skip(stream.bits() as usize % every).step_by(every)
}

/// The number of pixels that these draws stand for.
pub(crate) fn pixels_of(draws: &[Draw]) -> u64 {
    draws.iter().map(|draw| u64::from(draw.count)).sum()
}

/// The range of a task among `count` things that `tasks` tasks share.
pub(crate) fn portion(count: usize, task: usize, tasks: usize) -> Range<usize> {
    task * count / tasks..(task + 1) * count / tasks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balanced_parts_have_the_same_cost_and_all_draws() {
        let draw = |x: usize| Draw { view: 0, x: (x * 7919 % 5000) as u16, y: 0, count: 1 };
        let draws: Vec<Draw> = (0..5000).map(draw).collect();
        let ordered = balanced(&draws, |draw| f64::from(draw.x).powi(2));
        for round in ordered.chunks(ROUND) {
            let cost = |part: usize| {
                let own = &round[portion(round.len(), part, PARTS)];
                own.iter().map(|draw| f64::from(draw.x).powi(2)).sum::<f64>()
            };
            let costs: Vec<f64> = (0..PARTS).map(cost).collect();
            let mean = costs.iter().sum::<f64>() / PARTS as f64;
            assert!(costs.iter().all(|cost| (cost / mean - 1.0).abs() < 0.1), "{costs:?}");
        }
        let mut numbers: Vec<u16> = ordered.iter().map(|draw| draw.x).collect();
        numbers.sort_unstable();
        assert_eq!(numbers, (0..5000).collect::<Vec<u16>>());
    }
}
