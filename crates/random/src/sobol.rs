//! Scrambled Sobol sequences.
//!
//! Source: Burley, "Practical Hash-based Owen Scrambling", Journal of Computer Graphics Techniques
//! 9(4), 2020.

use std::ops::Range;

use sobol_burley::parts::{Int4, owen_scramble_int4_rev, sobol_int4_rev};

use crate::stream::Stream;

/// The longest run of Sobol points that is well distributed.
const RUN: u32 = 1 << 16;

impl Stream {
    /// Point `index` of the stream's Owen-scrambled Sobol sequence, in [0, 1)^D for D ≤ 4.
    ///
    /// After 65 536 points the sequence continues with a new scramble.
    pub fn sobol<const D: usize>(self, index: u32) -> [f64; D] {
        scrambled(unscrambled(index), self.scramble(index))
    }

    /// The points of [`Stream::sobol`] with the indices `range`. This takes less time than a call
    /// for each point.
    pub fn sobol_points<const D: usize>(self, range: Range<u32>) -> SobolPoints<D> {
        let (point, scramble) = (unscrambled(range.start), self.scramble(range.start));
        SobolPoints { stream: self, last: range.start, range, point, scramble }
    }

    /// The scramble of the run that point `index` belongs to.
    fn scramble(self, index: u32) -> Int4 {
        let run = u64::from(index / RUN);
        let [a, b] = [0, 1].map(|half| self.at(half).at(run).bits());
        [a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32].into()
    }
}

/// Consecutive points of a sequence; the result of [`Stream::sobol_points`].
#[derive(Clone, Debug)]
pub struct SobolPoints<const D: usize> {
    stream: Stream,
    range: Range<u32>,
    /// The index of the last point, or of the first one before any is made.
    last: u32,
    /// The unscrambled point of this index, and its scramble.
    point: Int4,
    scramble: Int4,
}

impl<const D: usize> Iterator for SobolPoints<D> {
    type Item = [f64; D];

    fn next(&mut self) -> Option<[f64; D]> {
        let index = self.range.next()?;
        if index / RUN != self.last / RUN {
            self.scramble = self.stream.scramble(index);
        }
        // A Sobol point is a sum modulo 2 over the bits of its index: only the bits that change
        // have to be added, two on average.
        self.point ^= unscrambled(index ^ self.last);
        self.last = index;
        Some(scrambled(self.point, self.scramble))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.range.size_hint()
    }
}

impl<const D: usize> ExactSizeIterator for SobolPoints<D> {}

/// The Sobol point of an index modulo the run, with the bits of its coordinates reversed.
fn unscrambled(index: u32) -> Int4 {
    // The sampler of `sobol_burley` also shuffles the indices, for points of more than four
    // dimensions, and takes three times as long.
    sobol_int4_rev((index % RUN).reverse_bits(), 0)
}

fn scrambled<const D: usize>(point: Int4, scramble: Int4) -> [f64; D] {
    let point = owen_scramble_int4_rev(point, scramble).reverse_bits().to_f32_norm();
    std::array::from_fn(|d| f64::from(point[d]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_quarter_of_a_run_has_its_share() {
        for seed in 0..20 {
            let stream = Stream::of_seed(seed);
            let mut count = [0; 4];
            for i in 0..64 {
                let [x, y] = stream.sobol(i);
                count[usize::from(x >= 0.5) + 2 * usize::from(y >= 0.5)] += 1;
            }
            assert_eq!(count, [16; 4]);
        }
    }

    /// At the start of a sequence, inside a run, across the end of a run, and at the last index.
    #[test]
    fn consecutive_points_are_those_of_their_indices() {
        let stream = Stream::of_seed(5);
        for range in
            [0..300, 77..99, RUN - 3..RUN + 70, 3 * RUN - 1..3 * RUN + 1, u32::MAX - 2..u32::MAX]
        {
            let points: Vec<[f64; 4]> = stream.sobol_points(range.clone()).collect();
            let expected: Vec<[f64; 4]> = range.map(|i| stream.sobol(i)).collect();
            assert_eq!(points, expected);
        }
    }
}
