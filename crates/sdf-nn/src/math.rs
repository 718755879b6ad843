//! Exponential, logarithm and sine as polynomials that compilers vectorise, for single precision.

use field::Real;

/// A precision the kernels run in: with its own elementary functions.
pub trait Lane: Real {
    /// exp(−x) for x ≥ 0; 0 where it would be denormal.
    fn exp_negative(x: Self) -> Self;
    /// ln(1 + x) for 0 ≤ x ≤ 1.
    fn ln_one_plus(x: Self) -> Self;
    /// The sine and the cosine of x, |x| up to 1e4.
    fn sin_cos_moderate(x: Self) -> (Self, Self);
}

/// 1.5 · 2²³: adding it rounds a small number to an integer, which then stands in the low bits.
const ROUND: f32 = 12_582_912.0;

impl Lane for f32 {
    #[inline(always)]
    fn exp_negative(x: f32) -> f32 {
        // exp(−x) = 2ⁿ exp(r) with r in [−ln 2/2, ln 2/2]; ln 2 is split in two so that n ln 2 is exact.
        let x = if x < 87.0 { -x } else { -87.0 };
        let shifted = x * std::f32::consts::LOG2_E + ROUND;
        let n = shifted - ROUND;
        let r = (x - n * 0.693_359_4) + n * 2.121_944_4e-4;
        // Taylor to the sixth order: the rest, r⁷/5040, is below 1.3e-7 relative.
        let p = 1.0 / 720.0;
        let p = p * r + 1.0 / 120.0;
        let p = p * r + 1.0 / 24.0;
        let p = p * r + 1.0 / 6.0;
        let p = p * r + 0.5;
        let p = p * r + 1.0;
        let p = p * r + 1.0;
        let exponent = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
        p * f32::from_bits(exponent)
    }

    #[inline(always)]
    fn ln_one_plus(x: f32) -> f32 {
        // ln(1 + x) = 2 artanh(s), s = x/(2 + x) ≤ 1/3: the odd series, cut after s¹³.
        let s = x / (2.0 + x);
        let q = s * s;
        let p = 1.0 / 13.0;
        let p = p * q + 1.0 / 11.0;
        let p = p * q + 1.0 / 9.0;
        let p = p * q + 1.0 / 7.0;
        let p = p * q + 0.2;
        let p = p * q + 1.0 / 3.0;
        let p = p * q + 1.0;
        2.0 * s * p
    }

    #[inline(always)]
    fn sin_cos_moderate(x: f32) -> (f32, f32) {
        // x = n π/2 + r with |r| ≤ π/4; π/2 in three parts whose products with n are exact for n below 2¹¹ or so.
        let shifted = x * std::f32::consts::FRAC_2_PI + ROUND;
        let n = shifted - ROUND;
        let quadrant = shifted.to_bits();
        let r = ((x - n * 1.570_312_5) - n * 4.837_513e-4) - n * 7.549_79e-8;
        let q = r * r;
        let sine = r + r * q * (-1.666_665_5e-1 + q * (8.332_161e-3 - q * 1.951_529_6e-4));
        let cosine = 1.0 - 0.5 * q + q * q * (4.166_664_6e-2 + q * (-1.388_731_6e-3 + q * 2.443_315_7e-5));
        let swap = quadrant & 1 == 1;
        let (s, c) = if swap { (cosine, sine) } else { (sine, cosine) };
        let sign_s = (quadrant & 2) << 30;
        let sign_c = (quadrant.wrapping_add(1) & 2) << 30;
        (f32::from_bits(s.to_bits() ^ sign_s), f32::from_bits(c.to_bits() ^ sign_c))
    }
}

impl Lane for f64 {
    #[inline(always)]
    fn exp_negative(x: f64) -> f64 {
        (-x).exp()
    }
    #[inline(always)]
    fn ln_one_plus(x: f64) -> f64 {
        x.ln_1p()
    }
    #[inline(always)]
    fn sin_cos_moderate(x: f64) -> (f64, f64) {
        x.sin_cos()
    }
}
