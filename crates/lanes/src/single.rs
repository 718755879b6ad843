//! Exponential and logarithm in single precision.

use super::isa::{Isa, fma};

/// 1.5 · 2²³: adding it rounds a small number to an integer, which the low bits of the sum hold.
pub(super) const ROUND_SINGLE: f32 = 12_582_912.0;

/// a b + c in single precision.
#[inline(always)]
pub(super) fn madd<I: Isa>(a: f32, b: f32, c: f32) -> f32 {
    fma::<f32, I>(a, b, c)
}

/// The largest x of [`exp_negative`]. Above, 1 + exp(−x) is 1; much smaller results would have
/// denormal squares, which are slow.
pub(super) const MOST: f32 = 20.0;

/// Coefficients of the exponential, the highest order first: 1 + r, and the minimax fit to the rest
/// in relative error, 1.1e-7, for |r| ≤ ln 2/2.
pub(super) const EXPONENTIAL: [f32; 6] =
    [8.312_521e-3, 4.189_015_6e-2, 0.166_671_14, 0.499_992_3, 1.0, 1.0];

/// Coefficients of ln(1 + x)/x, the highest order first: the minimax fit on [0, 1] in relative
/// error.
pub(super) const LOGARITHM: [f32; 8] = [
    -0.008_539_208,
    0.044_089_634,
    -0.107_681_714,
    0.177_452_42,
    -0.244_954_63,
    0.332_754_8,
    -0.499_974_04,
    0.999_999_8,
];

/// A polynomial by Horner's rule, which takes the fewest operations. Its chain costs little time:
/// that of several numbers is computed at once.
#[inline(always)]
fn polynomial<I: Isa>(coefficients: &[f32], x: f32) -> f32 {
    let (first, others) = (coefficients[0], &coefficients[1..]);
    others.iter().fold(first, |sum, c| madd::<I>(sum, x, *c))
}

/// [`Lane::exp_negative`](crate::Lane::exp_negative).
#[inline(always)]
pub(super) fn exp_negative<I: Isa>(x: f32) -> f32 {
    // exp(−x) = 2ⁿ exp(r) with r in [−ln 2/2, ln 2/2].
    let x = if x < MOST { x } else { MOST };
    let shifted = madd::<I>(x, -std::f32::consts::LOG2_E, ROUND_SINGLE);
    let n = shifted - ROUND_SINGLE;
    let r = if I::FMA {
        madd::<I>(n, -std::f32::consts::LN_2, -x)
    } else {
        // ln 2 is split into two parts, so that n times the first is exact.
        n * 2.121_944_4e-4 + (n * -0.693_359_4 - x)
    };
    let p = polynomial::<I>(&EXPONENTIAL, r);
    // The low bits of `shifted` are n: it goes to the exponent of p.
    f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
}

/// [`Lane::ln_one_plus`](crate::Lane::ln_one_plus).
#[inline(always)]
pub(super) fn ln_one_plus<I: Isa>(x: f32) -> f32 {
    x * polynomial::<I>(&LOGARITHM, x)
}
