//! Random numbers: a pure function of what they are for, so that no order of evaluation can change
//! them.

use sobol_burley::parts::{owen_scramble_int4_rev, sobol_int4_rev};

/// A well-mixed number from two (the finaliser of SplitMix64).
pub fn mix(a: u64, b: u64) -> u64 {
    let mut z =
        a.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(b).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A number in [0, 1) from a mixed integer.
pub fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1u64 << 53) as f64
}

/// The longest run of points that is still well distributed.
const SOBOL_LENGTH: u32 = 1 << 16;

/// Point `index` of the Owen-scrambled Sobol sequence `stream`, in [0, 1)^D for D ≤ 4.
///
/// Streams are independent. Past 65 536 points a stream goes on with a fresh scramble.
pub fn sobol<const D: usize>(index: u32, stream: u64) -> [f64; D] {
    // The library's own sampler shuffles the indices too, for points of more dimensions than four,
    // and takes three times as long.
    let scramble = [0, 1].map(|half| mix(mix(stream, half), u64::from(index / SOBOL_LENGTH)));
    let scramble = [
        scramble[0] as u32,
        (scramble[0] >> 32) as u32,
        scramble[1] as u32,
        (scramble[1] >> 32) as u32,
    ];
    let point = sobol_int4_rev((index % SOBOL_LENGTH).reverse_bits(), 0);
    let point = owen_scramble_int4_rev(point, scramble.into()).reverse_bits().to_f32_norm();
    std::array::from_fn(|d| f64::from(point[d]))
}

/// Two independent standard normal numbers from a point of the unit square (Box and Muller).
pub fn gaussian([a, b]: [f64; 2]) -> [f64; 2] {
    let radius = (-2.0 * (1.0 - a).ln()).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * b).sin_cos();
    [radius * cos, radius * sin]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_quarter_of_a_run_holds_its_share() {
        for stream in 0..20 {
            let mut count = [0; 4];
            for i in 0..64 {
                let [x, y] = sobol(i, stream);
                count[usize::from(x >= 0.5) + 2 * usize::from(y >= 0.5)] += 1;
            }
            assert_eq!(count, [16; 4]);
        }
    }

    #[test]
    fn gaussian_numbers_have_unit_variance() {
        let points: Vec<[f64; 2]> = (0..4096).map(|i| gaussian(sobol(i, 3))).collect();
        for d in 0..2 {
            let mean = points.iter().map(|p| p[d]).sum::<f64>() / 4096.0;
            let square = points.iter().map(|p| p[d] * p[d]).sum::<f64>() / 4096.0;
            assert!(
                mean.abs() < 0.01 && (square - 1.0).abs() < 0.02,
                "mean {mean}, variance {square}"
            );
        }
        assert!(gaussian([0.0, 0.3])[0].is_finite());
    }

    #[test]
    fn mixed_numbers_fill_the_unit_interval() {
        let mean = (0..10_000).map(|i| unit(mix(7, i))).sum::<f64>() / 1e4;
        assert!((mean - 0.5).abs() < 0.01, "mean {mean}");
    }
}
