//! Exponential, logarithm and sine as polynomials that compilers vectorise, for single precision.

use field::Real;

use crate::kernel::fma;

/// A precision the kernels run in: with its own elementary functions. `FMA` as in the kernels.
pub trait Lane: Real {
    /// exp(−x) for x ≥ 0. In single precision within 2.2 ulp (2.6e-7) up to x = 20, and constant (2e-9) beyond.
    fn exp_negative<const FMA: bool>(x: Self) -> Self;
    /// ln(1 + x) for 0 ≤ x ≤ 1. Within 4e-7, relative, in single precision.
    fn ln_one_plus<const FMA: bool>(x: Self) -> Self;
    /// The sine and the cosine of x, |x| up to 1e4. Within 2e-7, absolute, in single precision up to 1e3.
    fn sin_cos_moderate<const FMA: bool>(x: Self) -> (Self, Self);
}

/// 1.5 · 2²³: adding it rounds a small number to an integer, which then stands in the low bits.
const ROUND: f32 = 12_582_912.0;

#[inline(always)]
fn madd<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    fma::<f32, FMA>(a, b, c)
}

impl Lane for f32 {
    #[inline(always)]
    fn exp_negative<const FMA: bool>(x: f32) -> f32 {
        // exp(−x) = 2ⁿ exp(r) with r in [−ln 2/2, ln 2/2]; ln 2 is split in two so that n ln 2 is exact.
        // Beyond 20 nothing that is added to 1 is left; going on would make denormal squares, which are slow.
        let x = if x < 20.0 { -x } else { -20.0 };
        let shifted = madd::<FMA>(x, std::f32::consts::LOG2_E, ROUND);
        let n = shifted - ROUND;
        let r = madd::<FMA>(n, 2.121_944_4e-4, madd::<FMA>(n, -0.693_359_4, x));
        // Taylor to the sixth order, in pairs (Estrin) for short chains: the rest, r⁷/5040, is below 1.3e-7 relative.
        let q = r * r;
        let high = madd::<FMA>(madd::<FMA>(1.0 / 720.0, r, 1.0 / 120.0), r, 1.0 / 24.0);
        let middle = madd::<FMA>(1.0 / 6.0, r, 0.5);
        let p = madd::<FMA>(madd::<FMA>(high, q, middle), q, 1.0 + r);
        let exponent = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
        p * f32::from_bits(exponent)
    }

    #[inline(always)]
    fn ln_one_plus<const FMA: bool>(x: f32) -> f32 {
        // x times a polynomial of degree 7 fitted to ln(1 + x)/x on [0, 1] for the least largest relative error.
        let q = x * x;
        let a = madd::<FMA>(-0.499_974_05, x, 0.999_999_8);
        let b = madd::<FMA>(-0.244_954_65, x, 0.332_754_8);
        let c = madd::<FMA>(-0.107_681_81, x, 0.177_452_48);
        let d = madd::<FMA>(-0.008_539_228, x, 0.044_089_7);
        let low = madd::<FMA>(b, q, a);
        let high = madd::<FMA>(d, q, c);
        x * madd::<FMA>(high, q * q, low)
    }

    #[inline(always)]
    fn sin_cos_moderate<const FMA: bool>(x: f32) -> (f32, f32) {
        // x = n π/2 + r with |r| ≤ π/4; π/2 in three parts whose products with n are exact for n below 2¹¹ or so.
        let shifted = madd::<FMA>(x, std::f32::consts::FRAC_2_PI, ROUND);
        let n = shifted - ROUND;
        let quadrant = shifted.to_bits();
        let r = madd::<FMA>(n, -4.837_513e-4, madd::<FMA>(n, -1.570_312_5, x));
        let r = madd::<FMA>(n, -7.549_79e-8, r);
        let q = r * r;
        let s = madd::<FMA>(madd::<FMA>(-1.951_529_6e-4, q, 8.332_161e-3), q, -1.666_665_5e-1);
        let sine = madd::<FMA>(r * q, s, r);
        let c = madd::<FMA>(madd::<FMA>(2.443_315_7e-5, q, -1.388_731_6e-3), q, 4.166_664_6e-2);
        let cosine = madd::<FMA>(q * q, c, madd::<FMA>(-0.5, q, 1.0));
        let swap = quadrant & 1 == 1;
        let (s, c) = if swap { (cosine, sine) } else { (sine, cosine) };
        let sign_s = (quadrant & 2) << 30;
        let sign_c = (quadrant.wrapping_add(1) & 2) << 30;
        (f32::from_bits(s.to_bits() ^ sign_s), f32::from_bits(c.to_bits() ^ sign_c))
    }
}

impl Lane for f64 {
    #[inline(always)]
    fn exp_negative<const FMA: bool>(x: f64) -> f64 {
        (-x).exp()
    }
    #[inline(always)]
    fn ln_one_plus<const FMA: bool>(x: f64) -> f64 {
        x.ln_1p()
    }
    #[inline(always)]
    fn sin_cos_moderate<const FMA: bool>(x: f64) -> (f64, f64) {
        x.sin_cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The largest error over a dense set of arguments.
    fn worst(range: std::ops::Range<f64>, error: impl Fn(f32) -> f64) -> f64 {
        (0..200_000)
            .map(|i| error((range.start + (range.end - range.start) * f64::from(i) / 2e5) as f32))
            .fold(0.0, f64::max)
    }

    fn check<const FMA: bool>() {
        let exp = worst(0.0..20.0, |x| {
            let want = (-f64::from(x)).exp();
            (f64::from(f32::exp_negative::<FMA>(x)) - want).abs() / want
        });
        let ln = worst(1e-6..1.0, |x| {
            let want = f64::from(x).ln_1p();
            (f64::from(f32::ln_one_plus::<FMA>(x)) - want).abs() / want
        });
        let wave = worst(-1e3..1e3, |x| {
            let (s, c) = f32::sin_cos_moderate::<FMA>(x);
            let (want_s, want_c) = f64::from(x).sin_cos();
            (f64::from(s) - want_s).abs().max((f64::from(c) - want_c).abs())
        });
        println!("exp {exp:.2e}, ln {ln:.2e}, sine and cosine {wave:.2e}");
        assert!(exp < 2.7e-7 && ln < 4.5e-7 && wave < 2e-7, "exp {exp:.2e}, ln {ln:.2e}, waves {wave:.2e}");
    }

    #[test]
    fn polynomials_are_as_close_as_they_say() {
        check::<false>();
        check::<true>();
    }

    #[test]
    fn ends_and_poison() {
        assert_eq!(f32::exp_negative::<false>(0.0), 1.0);
        assert!(f32::exp_negative::<false>(f32::INFINITY) < 3e-9);
        assert_eq!(f32::ln_one_plus::<false>(0.0), 0.0);
        assert!(f32::sin_cos_moderate::<false>(f32::NAN).0.is_nan());
    }
}
