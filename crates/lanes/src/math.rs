//! Exponential, logarithm, sine and cosine as polynomials without branches, which the compiler
//! vectorises.
//!
//! Arguments are first reduced with constants split into exact parts: W. J. Cody and W. Waite,
//! “Software Manual for the Elementary Functions”, Prentice-Hall, 1980. An ulp is a unit in the
//! last place of the result.

use field::Real;

use crate::single::{self, ROUND_SINGLE, madd};
use crate::{Group, Isa, Plain, Row, Softplus, Sums, TILE, TableRows, fma, portable};

/// A precision of the kernels, `f32` or `f64`, with its elementary functions.
pub trait Lane: Real {
    /// Numbers of a group of points.
    type Group<I: Isa>: Group<Self>;

    /// exp(−x) for x ≥ 0.
    ///
    /// Single precision: within 2.6 ulp up to x = 20, constant (2e-9) above. Double precision:
    /// within 1.1 ulp up to x = 40, constant (4e-18) above. A NaN gives that constant.
    fn exp_negative<I: Isa>(x: Self) -> Self;
    /// ln(1 + x) for 0 ≤ x ≤ 1, within 4.7 ulp in single precision and 3 ulp in double precision.
    fn ln_one_plus<I: Isa>(x: Self) -> Self;
    /// ln(1 + exp(β z))/β for the first `N` lanes of a row, with `STORE` also its slope, and with
    /// both flags its curvature.
    ///
    /// A NaN gives a NaN, with a slope that is a number.
    #[inline(always)]
    fn softplus<I: Isa, const N: usize, const STORE: bool, const TANGENT: bool>(
        beta: f64,
        z: &Row<Self>,
        mut out: Softplus<'_, Self>,
    ) {
        for l in 0..N {
            let e = Self::exp_negative::<I>(Self::of(beta) * z.0[l].abs());
            let ln = Self::ln_one_plus::<I>(e);
            portable::softplus_lane::<Self, I, STORE, TANGENT>(beta, z.0[l], [e, ln], &mut out, l);
        }
    }
    /// The sine and the cosine of x.
    ///
    /// Their absolute errors are within 0.8 ulp of 1 up to |x| = 1e3 in single precision, and
    /// within 0.6 ulp of 1 up to |x| = 1e4 in double precision. Larger arguments lose accuracy.
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
        portable::multiply::<Self, I, N>(packed, start, rows, input, output);
    }
    #[doc(hidden)]
    #[inline(always)]
    fn multiply_few<I: Isa, const P: usize>(
        columns: &[Row<Self>],
        start: &[Row<Self>],
        input: [&[Row<Self>]; P],
        output: &mut [Row<Self>],
    ) {
        portable::multiply_few::<Self, I, P>(columns, start, input, output);
    }
    #[doc(hidden)]
    #[inline(always)]
    fn outer<I: Isa>(
        sides: &[(&[Row<Self>], &[Self])],
        rows: usize,
        columns: usize,
        gradient: &mut [Self],
    ) {
        portable::outer::<Self, I>(sides, rows, columns, gradient);
    }
    /// Transposes rows of lanes: `out[lane * padded(rows.len()) + row]`. The padding is
    /// unspecified.
    #[inline(always)]
    fn transpose<I: Isa>(rows: &[Row<Self>], out: &mut [Self]) {
        portable::transpose(rows, out);
    }
    /// The sums of rows of a table with weights, for a group of points.
    ///
    /// They have the weights of the `ORDER` and lower ones: none, x, y for 1, and also xx, xy, yy
    /// for 2. Those of a point without rows are zero.
    #[inline(always)]
    fn sum_rows<I: Isa, const T: usize, const ORDER: usize>(
        rows: &TableRows<'_, Self, T>,
        sums: &mut Sums<Self>,
    ) {
        portable::sum_rows::<Self, I, T, ORDER>(rows, sums);
    }
}

impl Lane for f32 {
    type Group<I: Isa> = I::Group;

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
    fn multiply_few<I: Isa, const P: usize>(
        columns: &[Row<f32>],
        start: &[Row<f32>],
        input: [&[Row<f32>]; P],
        output: &mut [Row<f32>],
    ) {
        I::multiply_few::<P>(columns, start, input, output);
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
    fn sum_rows<I: Isa, const T: usize, const ORDER: usize>(
        rows: &TableRows<'_, f32, T>,
        sums: &mut Sums<f32>,
    ) {
        I::sum_rows::<T, ORDER>(rows, sums);
    }
    #[inline(always)]
    fn exp_negative<I: Isa>(x: f32) -> f32 {
        single::exp_negative::<I>(x)
    }
    #[inline(always)]
    fn ln_one_plus<I: Isa>(x: f32) -> f32 {
        single::ln_one_plus::<I>(x)
    }
    #[inline(always)]
    fn softplus<I: Isa, const N: usize, const STORE: bool, const TANGENT: bool>(
        beta: f64,
        z: &Row<f32>,
        out: Softplus<'_, f32>,
    ) {
        I::softplus::<N, STORE, TANGENT>(beta, z, out);
    }

    #[inline(always)]
    fn sin_cos_moderate<I: Isa>(x: f32) -> (f32, f32) {
        // x = n π/2 + r with |r| ≤ π/4. π/2 is split into three parts; products of the first two
        // with n are exact for n below about 2¹¹.
        let shifted = madd::<I>(x, std::f32::consts::FRAC_2_PI, ROUND_SINGLE);
        let n = shifted - ROUND_SINGLE;
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
    type Group<I: Isa> = Plain<f64, I>;

    #[inline(always)]
    fn exp_negative<I: Isa>(x: f64) -> f64 {
        let x = if x < 40.0 { -x } else { -40.0 };
        let shifted = fma::<f64, I>(x, std::f64::consts::LOG2_E, ROUND_DOUBLE);
        let n = shifted - ROUND_DOUBLE;
        // ln 2 is split into two parts; the last 20 bits of the first are zero.
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
        // π/2 is split into three parts. The first two have 33 bits: their products with n are
        // exact for n below 2²⁰.
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

/// 1.5 · 2⁵²: [`ROUND_SINGLE`] for double precision.
const ROUND_DOUBLE: f64 = 6_755_399_441_055_744.0;

/// Coefficients of p in ln(1 + x) = s p(s²) with s = x/(2 + x).
///
/// p is a fit to 2 atanh(√q)/√q on 0 ≤ q ≤ 1/9 with an error of 3e-18.
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

/// Taylor coefficients of the cosine: ±1/n! for n = 2, 4, …, 16.
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
/// Taylor coefficients of the sine: ±1/n! for n = 3, 5, …, 15.
const SINE: [f64; 7] = [
    -1.0 / 6.0,
    1.0 / 120.0,
    -1.0 / 5_040.0,
    1.0 / 362_880.0,
    -1.0 / 39_916_800.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 1_307_674_368_000.0,
];

/// Taylor coefficients of the exponential: 1/n! for n = 0 to 13.
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

/// A polynomial with these coefficients, constant first, by Horner's rule.
#[inline(always)]
fn polynomial<I: Isa>(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| fma::<f64, I>(sum, x, *c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Instructions, LANES, Pass, Portable, dispatch};

    /// The largest error over 200,000 arguments, in ulp of the exact result, or of `least` where
    /// the result is smaller. `pair` gives the computed and the exact result.
    fn largest_error<R: Real>(
        range: std::ops::Range<f64>,
        least: f64,
        pair: impl Fn(R) -> (R, f64),
    ) -> f64 {
        let ulps = |(computed, exact): (R, f64)| {
            let binade = exact.abs().max(least).log2().floor().exp2();
            (computed.to_double() - exact).abs() / (binade * R::epsilon().to_double())
        };
        (0..200_000)
            .map(|i| {
                ulps(pair(R::of(range.start + (range.end - range.start) * f64::from(i) / 2e5)))
            })
            .fold(0.0, f64::max)
    }

    /// Compares with the standard library in double precision, whose own error is within an ulp:
    /// exp up to `exp_end`, sine and cosine up to ±`wave_end`.
    fn check<R: Lane, I: Isa>(
        exp_end: f64,
        wave_end: f64,
        [exp_limit, ln_limit, wave_limit]: [f64; 3],
    ) {
        let double = |x: R| x.to_double();
        let exp = largest_error::<R>(0.0..exp_end, 0.0, |x| {
            (R::exp_negative::<I>(x), (-double(x)).exp())
        });
        let ln =
            largest_error::<R>(1e-6..1.0, 0.0, |x| (R::ln_one_plus::<I>(x), double(x).ln_1p()));
        // Errors of sine and cosine count in ulp of 1: just below 1, an ulp is half of that.
        let sine = largest_error::<R>(-wave_end..wave_end, 1.0, |x| {
            (R::sin_cos_moderate::<I>(x).0, double(x).sin())
        });
        let cosine = largest_error::<R>(-wave_end..wave_end, 1.0, |x| {
            (R::sin_cos_moderate::<I>(x).1, double(x).cos())
        });
        println!("ulp: exp {exp:.2}, ln {ln:.2}, sine {sine:.2}, cosine {cosine:.2}");
        assert!(exp <= exp_limit, "exp: error {exp} ulp, limit {exp_limit}");
        assert!(ln <= ln_limit, "ln: error {ln} ulp, limit {ln_limit}");
        assert!(
            sine.max(cosine) <= wave_limit,
            "errors of sine {sine} ulp, of cosine {cosine} ulp, limit {wave_limit}"
        );
    }

    struct Check;

    impl Pass for Check {
        fn run<I: Isa>(self) {
            check::<f32, I>(20.0, 1e3, [2.6, 4.7, 0.8]);
            check::<f64, I>(40.0, 1e4, [1.1, 3.0, 0.6]);
        }
    }

    #[test]
    fn errors_are_within_the_documented_limits() {
        let sets = Instructions::ALL.into_iter().filter(|set| set.are_available());
        sets.for_each(|set| dispatch(set, Check));
    }

    /// Compares rows of softplus, of one lane in five hundred NaN, with double precision.
    struct Rows;

    impl Pass for Rows {
        fn run<I: Isa>(self) {
            let beta = 100.0;
            for first in (-1000..1000).step_by(LANES) {
                let z = Row(std::array::from_fn(|l| {
                    let i = first + l as i32;
                    if i % 500 == 7 { f32::NAN } else { 2.7e-4 * i as f32 }
                }));
                let mut out = [Row::zero(); 3];
                let [value, slope, curvature] = &mut out;
                f32::softplus::<I, LANES, true, true>(beta, &z, [value, slope, curvature]);
                for l in 0..LANES {
                    let z = f64::from(z.0[l]);
                    let [value, slope, curvature] = out.map(|row| f64::from(row.0[l]));
                    if z.is_nan() {
                        assert!(value.is_nan() && slope.is_finite());
                        continue;
                    }
                    let e = (-beta * z.abs()).exp().max((-20f64).exp());
                    let (high, low) = (1.0 / (1.0 + e), e / (1.0 + e));
                    for (found, expected) in [
                        (value, z.max(0.0) + e.ln_1p() / beta),
                        (slope, if z > 0.0 { high } else { low }),
                        (curvature, beta * high * low),
                    ] {
                        // x has a rounding error of up to 1e-6.
                        assert!((found - expected).abs() <= 3e-6 * expected, "{z}: {found}");
                    }
                }
            }
        }
    }

    #[test]
    fn rows_of_softplus_are_those_of_double_precision() {
        let sets = Instructions::ALL.into_iter().filter(|set| set.are_available());
        sets.for_each(|set| dispatch(set, Rows));
    }

    #[test]
    fn results_at_zero_infinity_and_nan() {
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
