//! Harm to a valid file: hostile values at one or two places.

use std::fmt::Debug;

use proptest::collection::vec;
use proptest::prelude::*;

/// A structured file that can be harmed.
pub(crate) trait Spoil: Clone + Debug + 'static {
    /// Does harm number `harm` at place number `place`; both are taken modulo their count.
    fn spoil(&mut self, place: usize, harm: usize);
}

/// Valid values with harm at no place (two in ten), one place (six in ten) or two.
pub(crate) fn spoiled<T: Spoil>(base: impl Strategy<Value = T> + 'static) -> BoxedStrategy<T> {
    let spots = prop_oneof![2 => Just(0usize), 6 => Just(1), 2 => Just(2)]
        .prop_flat_map(|count| vec(any::<(usize, usize)>(), count));
    (base, spots)
        .prop_map(|(mut value, spots)| {
            for (place, harm) in spots {
                value.spoil(place, harm);
            }
            value
        })
        .boxed()
}

/// Valid values, one in eight of them with harm.
pub(crate) fn sometimes_spoiled<T: Spoil>(
    base: impl Strategy<Value = T> + Clone + 'static,
) -> BoxedStrategy<T> {
    prop_oneof![7 => base.clone(), 1 => spoiled(base)].boxed()
}

/// Integers at the borders of types and of sizes that fit in memory.
const INTEGERS: [u64; 14] = [
    0,
    1,
    2,
    u64::MAX,
    (1 << 31) - 1,
    1 << 31,
    (1 << 32) - 1,
    1 << 32,
    1 << 53,
    1 << 60,
    i64::MAX as u64,
    1 << 63,
    65_536,
    1_000_000_000,
];

/// A hostile integer in place of `value`.
pub(crate) fn integer(value: u64, harm: usize) -> u64 {
    match harm % (INTEGERS.len() + 3) {
        0 => value.wrapping_add(1),
        1 => value.wrapping_sub(1),
        2 => value.wrapping_mul(2),
        other => INTEGERS[other - 3],
    }
}

/// A hostile number of floating point in place of `value`.
pub(crate) fn float(value: f64, harm: usize) -> f64 {
    let values =
        [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -value, 1e300, -1e300, 1e-320, 1e18];
    values[harm % values.len()]
}

/// Hostile bytes in place of `value`.
pub(crate) fn bytes(value: &[u8], harm: usize) -> Vec<u8> {
    match harm % 9 {
        0 => Vec::new(),
        1 => value[..value.len() / 2].to_vec(),
        2 => vec![0xff; value.len()],
        3 => vec![0; value.len()],
        4 => value.repeat(repetitions(value.len(), 1000)),
        5 => [value, b"\0"].concat(),
        6 => b"\x1b[31m\n\r\x07\x7f".to_vec(),
        7 => b"\xff\xfe\xc3\x28".to_vec(),
        _ => vec![b'x'; 5000],
    }
}

/// The number of repetitions, at most `most`, of a part of `length` bytes: a case has a few
/// megabytes.
pub(crate) fn repetitions(length: usize, most: usize) -> usize {
    ((1 << 20) / length.max(1)).clamp(1, most)
}
