//! Streams of random numbers.

use crate::name::Name;

/// A stream of random numbers: a pure function of a seed, names and indices.
///
/// A computation takes a stream, and gives each of its decisions the part of that name:
///
/// ```
/// # use random::{Name, Stream};
/// const COINS: Name = Name::other("sides of a coin");
/// const DICE: Name = Name::other("sides of a die");
///
/// fn heads(stream: Stream) -> usize {
///     let coins = stream.named(COINS);
///     (0..100).filter(|i| coins.at(*i).unit() < 0.5).count()
/// }
/// # assert!(heads(Stream::of_seed(1)) < 100);
/// # assert_ne!(Stream::of_seed(1).named(COINS), Stream::of_seed(1).named(DICE));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    key: u64,
}

impl Stream {
    /// The stream of a seed. [`Stream::bits`] of it is the seed.
    pub fn of_seed(seed: u64) -> Self {
        Stream { key: seed }
    }

    /// The part of the stream for a decision; it can be divided further.
    #[must_use]
    pub fn named(self, name: Name) -> Self {
        Stream { key: mix(self.key, name.number()) }
    }

    /// The part of the stream at an index; it can be divided further.
    ///
    /// Divide a stream either by names or by indices: the index 4 and the name with the number 4
    /// give the same part.
    #[must_use]
    pub fn at(self, index: u64) -> Self {
        Stream { key: mix(self.key, index) }
    }

    /// 64 random bits, for example the seed of a computation that takes no stream.
    pub fn bits(self) -> u64 {
        self.key
    }

    /// A number uniform in [0, 1).
    pub fn unit(self) -> f64 {
        (self.key >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A point uniform in the unit ball.
    pub fn in_ball(self) -> [f64; 3] {
        let [a, b, c] = [0, 1, 2].map(|i| self.at(i).unit());
        let (z, angle) = (2.0 * a - 1.0, std::f64::consts::TAU * b);
        let across = (1.0 - z * z).sqrt();
        [across * angle.cos(), across * angle.sin(), z].map(|v| v * c.cbrt())
    }
}

/// A well-mixed number from two: the finaliser of SplitMix64 (Steele, Lea and Flood, "Fast
/// Splittable Pseudorandom Number Generators", OOPSLA 2014). Bijective in `b` for each `a`.
fn mix(a: u64, b: u64) -> u64 {
    let mut z =
        a.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(b).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Two independent standard normal numbers from a point of the unit square (Box and Muller 1958).
pub fn gaussian([a, b]: [f64; 2]) -> [f64; 2] {
    let radius = (-2.0 * (1.0 - a).ln()).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * b).sin_cos();
    [radius * cos, radius * sin]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    const POINTS: Name = Name::other("points of a test");

    #[test]
    fn points_are_uniform_in_the_unit_ball() {
        let (n, stream) = (20_000, Stream::of_seed(1).named(POINTS));
        let points: Vec<[f64; 3]> = (0..n).map(|i| stream.at(i).in_ball()).collect();
        let length = |p: &[f64; 3]| p.iter().map(|v| v * v).sum::<f64>().sqrt();
        assert!(points.iter().all(|p| length(p) <= 1.0));
        let inner = points.iter().filter(|p| length(p) < 0.5).count() as f64 / n as f64;
        assert!((inner - 0.125).abs() < 0.01, "{inner} within half the radius");
        let mean = [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / n as f64);
        assert!(length(&mean) < 0.02, "{mean:?}");
    }

    #[test]
    fn gaussian_numbers_have_unit_variance() {
        let stream = Stream::of_seed(3).named(POINTS);
        let points: Vec<[f64; 2]> = (0..4096).map(|i| gaussian(stream.sobol(i))).collect();
        for d in 0..2 {
            let mean = points.iter().map(|p| p[d]).sum::<f64>() / 4096.0;
            let square = points.iter().map(|p| p[d] * p[d]).sum::<f64>() / 4096.0;
            assert!(mean.abs() < 0.01 && (square - 1.0).abs() < 0.02, "mean {mean}, {square}");
        }
        assert!(gaussian([0.0, 0.3])[0].is_finite());
    }

    #[test]
    fn numbers_are_uniform_in_the_unit_interval() {
        let stream = Stream::of_seed(7).named(POINTS);
        let mean = (0..10_000).map(|i| stream.at(i).unit()).sum::<f64>() / 1e4;
        assert!((mean - 0.5).abs() < 0.01, "mean {mean}");
    }

    /// Streams, their parts at 4096 indices, and parts of parts, for many names and five seeds.
    #[test]
    fn no_two_names_share_a_value() {
        let others = ["", "a", "b", "points of a test"].map(Name::other);
        let names = (1..=40).map(|number| Name::new("numbered", number)).chain(others);
        let names: Vec<Name> = names.collect();
        for seed in [0, 1, 2, 0x5eed, u64::MAX] {
            let mut seen = HashSet::new();
            let mut count = 0;
            for stream in names.iter().map(|name| Stream::of_seed(seed).named(*name)) {
                let parts = (0..4096).map(|i| stream.at(i));
                let nested = (0..64).flat_map(|i| (0..64).map(move |j| stream.at(i).at(j)));
                for part in parts.chain(nested).chain([stream]) {
                    seen.insert(part.bits());
                    count += 1;
                }
            }
            assert_eq!(seen.len(), count, "seed {seed}");
        }
    }

    /// Files of earlier fits can be continued: streams keep their bits.
    #[test]
    fn the_bits_of_a_name_are_those_of_its_number() {
        let stream = Stream::of_seed(42);
        assert_eq!(stream.bits(), 42);
        assert_eq!(stream.named(Name::new("a", 4)).at(17).bits(), 0xe178_3dfd_d77e_ad53);
        assert_eq!(stream.named(Name::new("b", 4)), stream.named(Name::new("a", 4)));
        assert_eq!(Stream::of_seed(stream.named(POINTS).bits()), stream.named(POINTS));
    }
}
