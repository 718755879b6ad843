//! Exponential, logarithm and sine as polynomials that compilers vectorise.

use field::Real;

use crate::kernel::{Row, TILE, fma, multiply_rows, outer_rows, transpose_lanes};
use crate::simd::Isa;

/// A precision the kernels run in: with its own elementary functions and matrix kernels.
pub trait Lane: Real {
    /// exp(−x) for x ≥ 0. In single precision within 3.1 ulp up to x = 20, and constant (2e-9)
    /// beyond; in double precision within 1.1 ulp up to 40, and constant (4e-18) beyond.
    fn exp_negative<I: Isa>(x: Self) -> Self;
    /// ln(1 + x) for 0 ≤ x ≤ 1, within 5.4 ulp in single precision, 3 in double.
    fn ln_one_plus<I: Isa>(x: Self) -> Self;
    /// The sine and the cosine of x: within 0.8 ulp of 1 up to |x| = 1e3 in single precision, and
    /// up to 1e4 within 0.6 ulp of 1 in double.
    fn sin_cos_moderate<I: Isa>(x: Self) -> (Self, Self);

    #[doc(hidden)]
    #[inline(always)]
    fn multiply<I: Isa, const N: usize>(
        packed: &[[Self; TILE]],
        start: &[Self],
        rows: usize,
        input: &[Row<Self>],
        output: &mut [Row<Self>],
    ) {
        multiply_rows::<Self, I, N>(packed, start, rows, input, output);
    }
    #[doc(hidden)]
    #[inline(always)]
    fn outer<I: Isa>(
        sides: &[(&[Row<Self>], &[Self])],
        rows: usize,
        columns: usize,
        gradient: &mut [Self],
    ) {
        outer_rows::<Self, I>(sides, rows, columns, gradient);
    }
    #[doc(hidden)]
    #[inline(always)]
    fn transpose<I: Isa>(rows: &[Row<Self>], out: &mut [Self]) {
        transpose_lanes(rows, out);
    }
}

/// 1.5 · 2²³: adding it rounds a small number to an integer, which then stands in the low bits.
const ROUND: f32 = 12_582_912.0;

#[inline(always)]
fn madd<I: Isa>(a: f32, b: f32, c: f32) -> f32 {
    fma::<f32, I>(a, b, c)
}

impl Lane for f32 {
    #[inline(always)]
    fn multiply<I: Isa, const N: usize>(
        packed: &[[f32; TILE]],
        start: &[f32],
        rows: usize,
        input: &[Row<f32>],
        output: &mut [Row<f32>],
    ) {
        I::multiply::<N>(packed, start, rows, input, output);
    }
    #[inline(always)]
    fn outer<I: Isa>(
        sides: &[(&[Row<f32>], &[f32])],
        rows: usize,
        columns: usize,
        gradient: &mut [f32],
    ) {
        I::outer(sides, rows, columns, gradient);
    }
    #[inline(always)]
    fn transpose<I: Isa>(rows: &[Row<f32>], out: &mut [f32]) {
        I::transpose(rows, out);
    }
    #[inline(always)]
    fn exp_negative<I: Isa>(x: f32) -> f32 {
        // exp(−x) = 2ⁿ exp(r) with r in [−ln 2/2, ln 2/2]; ln 2 is split in two so that n ln 2 is
        // exact. Beyond 20 nothing that is added to 1 is left; going on would make denormal
        // squares, which are slow.
        let x = if x < 20.0 { -x } else { -20.0 };
        let shifted = madd::<I>(x, std::f32::consts::LOG2_E, ROUND);
        let n = shifted - ROUND;
        let r = madd::<I>(n, 2.121_944_4e-4, madd::<I>(n, -0.693_359_4, x));
        // Taylor to the sixth order, in pairs (Estrin) for short chains: the rest, r⁷/5040, is
        // below 1.3e-7 relative.
        let q = r * r;
        let high = madd::<I>(madd::<I>(1.0 / 720.0, r, 1.0 / 120.0), r, 1.0 / 24.0);
        let middle = madd::<I>(1.0 / 6.0, r, 0.5);
        let p = madd::<I>(madd::<I>(high, q, middle), q, 1.0 + r);
        let exponent = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
        p * f32::from_bits(exponent)
    }

    #[inline(always)]
    fn ln_one_plus<I: Isa>(x: f32) -> f32 {
        // x times a polynomial of degree 7 fitted to ln(1 + x)/x on [0, 1] for the least largest
        // relative error.
        let q = x * x;
        let a = madd::<I>(-0.499_974_05, x, 0.999_999_8);
        let b = madd::<I>(-0.244_954_65, x, 0.332_754_8);
        let c = madd::<I>(-0.107_681_81, x, 0.177_452_48);
        let d = madd::<I>(-0.008_539_228, x, 0.044_089_7);
        let low = madd::<I>(b, q, a);
        let high = madd::<I>(d, q, c);
        x * madd::<I>(high, q * q, low)
    }

    #[inline(always)]
    fn sin_cos_moderate<I: Isa>(x: f32) -> (f32, f32) {
        // x = n π/2 + r with |r| ≤ π/4; π/2 in three parts whose products with n are exact for n
        // below 2¹¹ or so.
        let shifted = madd::<I>(x, std::f32::consts::FRAC_2_PI, ROUND);
        let n = shifted - ROUND;
        let quadrant = shifted.to_bits();
        let r = madd::<I>(n, -4.837_513e-4, madd::<I>(n, -1.570_312_5, x));
        let r = madd::<I>(n, -7.549_79e-8, r);
        let q = r * r;
        let s = madd::<I>(madd::<I>(-1.951_529_6e-4, q, 8.332_161e-3), q, -1.666_665_5e-1);
        let sine = madd::<I>(r * q, s, r);
        let c = madd::<I>(madd::<I>(2.443_315_7e-5, q, -1.388_731_6e-3), q, 4.166_664_6e-2);
        let cosine = madd::<I>(q * q, c, madd::<I>(-0.5, q, 1.0));
        let swap = quadrant & 1 == 1;
        let (s, c) = if swap { (cosine, sine) } else { (sine, cosine) };
        let sign_s = (quadrant & 2) << 30;
        let sign_c = (quadrant.wrapping_add(1) & 2) << 30;
        (f32::from_bits(s.to_bits() ^ sign_s), f32::from_bits(c.to_bits() ^ sign_c))
    }
}

impl Lane for f64 {
    #[inline(always)]
    fn exp_negative<I: Isa>(x: f64) -> f64 {
        let x = if x < 40.0 { -x } else { -40.0 };
        let shifted = fma::<f64, I>(x, std::f64::consts::LOG2_E, ROUND_DOUBLE);
        let n = shifted - ROUND_DOUBLE;
        // ln 2 in two parts, the first with 20 zeros at its end.
        let r = fma::<f64, I>(
            n,
            -1.908_214_929_270_587_7e-10,
            fma::<f64, I>(n, -0.693_147_180_369_123_8, x),
        );
        let exponent =
            shifted.to_bits().wrapping_sub(ROUND_DOUBLE.to_bits()).wrapping_add(1023) << 52;
        polynomial::<I>(&EXPONENTIAL, r) * f64::from_bits(exponent)
    }
    #[inline(always)]
    fn ln_one_plus<I: Isa>(x: f64) -> f64 {
        let s = x / (2.0 + x);
        s * polynomial::<I>(&LOGARITHM, s * s)
    }
    #[inline(always)]
    fn sin_cos_moderate<I: Isa>(x: f64) -> (f64, f64) {
        let shifted = fma::<f64, I>(x, std::f64::consts::FRAC_2_PI, ROUND_DOUBLE);
        let n = shifted - ROUND_DOUBLE;
        let quadrant = shifted.to_bits();
        // π/2 in three parts of 33 bits, whose products with n are exact for n below 2²⁰.
        let r = fma::<f64, I>(
            n,
            -6.077_100_506_303_966e-11,
            fma::<f64, I>(n, -1.570_796_326_734_125_6, x),
        );
        let r = fma::<f64, I>(n, -2.022_266_248_795_950_6e-21, r);
        let q = r * r;
        let sine = fma::<f64, I>(r * q, polynomial::<I>(&SINE, q), r);
        let cosine = fma::<f64, I>(q, polynomial::<I>(&COSINE, q), 1.0);
        let swap = quadrant & 1 == 1;
        let (s, c) = if swap { (cosine, sine) } else { (sine, cosine) };
        let sign_s = (quadrant & 2) << 62;
        let sign_c = (quadrant.wrapping_add(1) & 2) << 62;
        (f64::from_bits(s.to_bits() ^ sign_s), f64::from_bits(c.to_bits() ^ sign_c))
    }
}

/// 1.5 · 2⁵², for double precision as [`ROUND`] is for single.
const ROUND_DOUBLE: f64 = 6_755_399_441_055_744.0;

/// ln(1 + x) = s p(s²) with s = x/(2 + x): p is 2 atanh(√q)/√q, fitted on [0, 1/9] to 3e-18.
const LOGARITHM: [f64; 11] = [
    2.0,
    0.666_666_666_666_661_5,
    0.400_000_000_001_857_5,
    0.285_714_285_454_541_14,
    0.222_222_240_807_476_74,
    0.181_817_408_325_048_06,
    0.153_866_140_423_040_1,
    0.133_003_740_326_746_25,
    0.121_101_687_280_692_18,
    0.083_245_065_118_608_2,
    0.170_441_635_627_813_98,
];

/// Reciprocals of the factorials of 2, 4, … 16, and of 3, 5, … 15, with the signs of cosine and
/// sine.
const COSINE: [f64; 8] = [
    -1.0 / 2.0,
    1.0 / 24.0,
    -1.0 / 720.0,
    1.0 / 40_320.0,
    -1.0 / 3_628_800.0,
    1.0 / 479_001_600.0,
    -1.0 / 87_178_291_200.0,
    1.0 / 20_922_789_888_000.0,
];
const SINE: [f64; 7] = [
    -1.0 / 6.0,
    1.0 / 120.0,
    -1.0 / 5_040.0,
    1.0 / 362_880.0,
    -1.0 / 39_916_800.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 1_307_674_368_000.0,
];

/// Reciprocals of the factorials of 0 to 13.
const EXPONENTIAL: [f64; 14] = [
    1.0,
    1.0,
    1.0 / 2.0,
    1.0 / 6.0,
    1.0 / 24.0,
    1.0 / 120.0,
    1.0 / 720.0,
    1.0 / 5_040.0,
    1.0 / 40_320.0,
    1.0 / 362_880.0,
    1.0 / 3_628_800.0,
    1.0 / 39_916_800.0,
    1.0 / 479_001_600.0,
    1.0 / 6_227_020_800.0,
];

/// A polynomial by its coefficients, constant first.
#[inline(always)]
fn polynomial<I: Isa>(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| fma::<f64, I>(sum, x, *c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Pass, Portable, dispatch_all};

    /// The largest error over a dense set of arguments, in units in the last place of what is
    /// wanted, or of `least` if that is more. `pair` gives what came and what was wanted.
    fn worst<R: Real>(
        range: std::ops::Range<f64>,
        least: f64,
        pair: impl Fn(R) -> (R, f64),
    ) -> f64 {
        let ulps = |(got, want): (R, f64)| {
            let binade = want.abs().max(least).log2().floor().exp2();
            (got.to_double() - want).abs() / (binade * R::epsilon().to_double())
        };
        (0..200_000)
            .map(|i| {
                ulps(pair(R::of(range.start + (range.end - range.start) * f64::from(i) / 2e5)))
            })
            .fold(0.0, f64::max)
    }

    /// Double precision is compared with the standard library's, which is within an ulp itself.
    fn check<R: Lane, I: Isa>(reach: f64, wave: f64, [exp_most, ln_most, wave_most]: [f64; 3]) {
        let double = |x: R| x.to_double();
        let exp = worst::<R>(0.0..reach, 0.0, |x| (R::exp_negative::<I>(x), (-double(x)).exp()));
        let ln = worst::<R>(1e-6..1.0, 0.0, |x| (R::ln_one_plus::<I>(x), double(x).ln_1p()));
        // The wave's scale is 1: just below, an ulp is half of that above.
        let sine =
            worst::<R>(-wave..wave, 1.0, |x| (R::sin_cos_moderate::<I>(x).0, double(x).sin()));
        let cosine =
            worst::<R>(-wave..wave, 1.0, |x| (R::sin_cos_moderate::<I>(x).1, double(x).cos()));
        println!("ulp: exp {exp:.2}, ln {ln:.2}, sine {sine:.2}, cosine {cosine:.2}");
        assert!(exp <= exp_most, "exp: {exp} ulp, at most {exp_most}");
        assert!(ln <= ln_most, "ln: {ln} ulp, at most {ln_most}");
        assert!(
            sine.max(cosine) <= wave_most,
            "sine {sine}, cosine {cosine} ulp, at most {wave_most}"
        );
    }

    struct Check;

    impl Pass for Check {
        fn run<I: Isa>(self) {
            check::<f32, I>(20.0, 1e3, [3.1, 5.4, 0.8]);
            check::<f64, I>(40.0, 1e4, [1.1, 3.0, 0.6]);
        }
    }

    #[test]
    fn polynomials_are_as_close_as_they_say() {
        dispatch_all(|_| Check);
    }

    #[test]
    fn ends_and_poison() {
        assert_eq!(f32::exp_negative::<Portable>(0.0), 1.0);
        assert!(f32::exp_negative::<Portable>(f32::INFINITY) < 3e-9);
        assert_eq!(f32::ln_one_plus::<Portable>(0.0), 0.0);
        assert!(f32::sin_cos_moderate::<Portable>(f32::NAN).0.is_nan());
        assert_eq!(f64::exp_negative::<Portable>(0.0), 1.0);
        assert!(f64::exp_negative::<Portable>(f64::INFINITY) < 5e-18);
        assert_eq!(f64::ln_one_plus::<Portable>(0.0), 0.0);
        assert!(f64::sin_cos_moderate::<Portable>(f64::NAN).0.is_nan());
    }
}
