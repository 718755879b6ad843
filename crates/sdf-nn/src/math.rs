//! Exponential, logarithm and sine as polynomials that compilers vectorise, for single precision.

use field::Real;

use crate::kernel::{Row, TILE, fma, multiply_rows, outer_rows, transpose_lanes};
use crate::simd::Isa;

/// A precision the kernels run in: with its own elementary functions and matrix kernels.
pub trait Lane: Real {
    /// exp(−x) for x ≥ 0. In single precision within 2.2 ulp (2.6e-7) up to x = 20, and constant (2e-9) beyond.
    fn exp_negative<I: Isa>(x: Self) -> Self;
    /// ln(1 + x) for 0 ≤ x ≤ 1. Within 4e-7, relative, in single precision.
    fn ln_one_plus<I: Isa>(x: Self) -> Self;
    /// The sine and the cosine of x, |x| up to 1e4. Within 2e-7, absolute, in single precision up to 1e3.
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
    fn outer<I: Isa>(sides: &[(&[Row<Self>], &[Self])], rows: usize, columns: usize, gradient: &mut [Self]) {
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
    fn outer<I: Isa>(sides: &[(&[Row<f32>], &[f32])], rows: usize, columns: usize, gradient: &mut [f32]) {
        I::outer(sides, rows, columns, gradient);
    }
    #[inline(always)]
    fn transpose<I: Isa>(rows: &[Row<f32>], out: &mut [f32]) {
        I::transpose(rows, out);
    }
    #[inline(always)]
    fn exp_negative<I: Isa>(x: f32) -> f32 {
        // exp(−x) = 2ⁿ exp(r) with r in [−ln 2/2, ln 2/2]; ln 2 is split in two so that n ln 2 is exact.
        // Beyond 20 nothing that is added to 1 is left; going on would make denormal squares, which are slow.
        let x = if x < 20.0 { -x } else { -20.0 };
        let shifted = madd::<I>(x, std::f32::consts::LOG2_E, ROUND);
        let n = shifted - ROUND;
        let r = madd::<I>(n, 2.121_944_4e-4, madd::<I>(n, -0.693_359_4, x));
        // Taylor to the sixth order, in pairs (Estrin) for short chains: the rest, r⁷/5040, is below 1.3e-7 relative.
        let q = r * r;
        let high = madd::<I>(madd::<I>(1.0 / 720.0, r, 1.0 / 120.0), r, 1.0 / 24.0);
        let middle = madd::<I>(1.0 / 6.0, r, 0.5);
        let p = madd::<I>(madd::<I>(high, q, middle), q, 1.0 + r);
        let exponent = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
        p * f32::from_bits(exponent)
    }

    #[inline(always)]
    fn ln_one_plus<I: Isa>(x: f32) -> f32 {
        // x times a polynomial of degree 7 fitted to ln(1 + x)/x on [0, 1] for the least largest relative error.
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
        // x = n π/2 + r with |r| ≤ π/4; π/2 in three parts whose products with n are exact for n below 2¹¹ or so.
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
        (-x).exp()
    }
    #[inline(always)]
    fn ln_one_plus<I: Isa>(x: f64) -> f64 {
        x.ln_1p()
    }
    #[inline(always)]
    fn sin_cos_moderate<I: Isa>(x: f64) -> (f64, f64) {
        x.sin_cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Pass, Portable, dispatch_all};

    /// The largest error over a dense set of arguments.
    fn worst(range: std::ops::Range<f64>, error: impl Fn(f32) -> f64) -> f64 {
        (0..200_000)
            .map(|i| error((range.start + (range.end - range.start) * f64::from(i) / 2e5) as f32))
            .fold(0.0, f64::max)
    }

    fn check<I: Isa>() {
        let exp = worst(0.0..20.0, |x| {
            let want = (-f64::from(x)).exp();
            (f64::from(f32::exp_negative::<I>(x)) - want).abs() / want
        });
        let ln = worst(1e-6..1.0, |x| {
            let want = f64::from(x).ln_1p();
            (f64::from(f32::ln_one_plus::<I>(x)) - want).abs() / want
        });
        let wave = worst(-1e3..1e3, |x| {
            let (s, c) = f32::sin_cos_moderate::<I>(x);
            let (want_s, want_c) = f64::from(x).sin_cos();
            (f64::from(s) - want_s).abs().max((f64::from(c) - want_c).abs())
        });
        println!("exp {exp:.2e}, ln {ln:.2e}, sine and cosine {wave:.2e}");
        assert!(exp < 2.7e-7 && ln < 4.5e-7 && wave < 2e-7, "exp {exp:.2e}, ln {ln:.2e}, waves {wave:.2e}");
    }

    struct Check;

    impl Pass for Check {
        fn run<I: Isa>(self) {
            check::<I>();
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
    }
}
