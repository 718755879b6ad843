//! Dual numbers: forward-mode derivatives of formulas, nestable for second derivatives.
//!
//! The analytic shapes take all their derivatives from them, and tests compare hand-written
//! derivatives with them. Rules: Griewank and Walther, “Evaluating Derivatives”, 2nd edition, SIAM,
//! 2008, chapter 3.

use std::ops::{Add, Div, Mul, Neg, Sub};

use num_traits::Float;

use crate::real::Real;

/// A number type for formulas: a real number, or a [`Dual`] number with derivatives.
///
/// A formula written for any `Scalar` gives its value, its gradient and its second derivatives.
/// Comparisons use only the value: at a kink, the derivative is that of the branch taken.
pub trait Scalar:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The precision of the values and derivatives.
    type Real: Real;
    /// A constant: all its derivatives are zero.
    fn constant(value: Self::Real) -> Self;
    /// The value, without derivatives.
    fn real(self) -> Self::Real;
    /// The square root. Its derivative at 0, an infinite limit, is set to 0.
    fn sqrt(self) -> Self;
    /// The exponential.
    fn exp(self) -> Self;
    /// The natural logarithm.
    fn ln(self) -> Self;
    /// The sine.
    fn sin(self) -> Self;
    /// The cosine.
    fn cos(self) -> Self;

    /// The larger number, the first if they are equal. NaN if either is NaN.
    fn max(self, other: Self) -> Self {
        if self.real() >= other.real() || self.real().is_nan() { self } else { other }
    }
    /// The smaller number, the first if they are equal. NaN if either is NaN.
    fn min(self, other: Self) -> Self {
        if self.real() <= other.real() || self.real().is_nan() { self } else { other }
    }
    /// The absolute value. Its derivative at 0 is set to +1.
    fn abs(self) -> Self {
        if self.real() < num_traits::Zero::zero() { -self } else { self }
    }
}

/// A number without derivatives.
impl<R: Real> Scalar for R {
    type Real = R;
    fn constant(value: R) -> Self {
        value
    }
    fn real(self) -> R {
        self
    }
    fn sqrt(self) -> Self {
        Float::sqrt(self)
    }
    fn exp(self) -> Self {
        Float::exp(self)
    }
    fn ln(self) -> Self {
        Float::ln(self)
    }
    fn sin(self) -> Self {
        Float::sin(self)
    }
    fn cos(self) -> Self {
        Float::cos(self)
    }
}

/// A number with its derivatives in `N` directions.
///
/// A `Dual` of `Dual` numbers also has second derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<S, const N: usize> {
    /// The value.
    pub value: S,
    /// The derivatives in `N` directions.
    pub d: [S; N],
}

impl<S: Scalar, const N: usize> Dual<S, N> {
    /// An independent variable: its derivative is 1 in direction `index` and 0 in the others.
    ///
    /// # Panics
    /// If `index` is not below `N`.
    pub fn variable(value: S, index: usize) -> Self {
        let mut dual = Self::lift(value);
        dual.d[index] = S::constant(num_traits::One::one());
        dual
    }

    /// A number whose derivatives at this level of nesting are zero.
    pub fn lift(value: S) -> Self {
        Dual { value, d: [S::constant(num_traits::Zero::zero()); N] }
    }

    /// The chain rule: a function of `self` with this value and this slope.
    fn chain(self, value: S, slope: S) -> Self {
        Dual { value, d: self.d.map(|d| d * slope) }
    }
}

impl<S: Scalar, const N: usize> Add for Dual<S, N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Dual { value: self.value + other.value, d: std::array::from_fn(|i| self.d[i] + other.d[i]) }
    }
}

impl<S: Scalar, const N: usize> Sub for Dual<S, N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Dual { value: self.value - other.value, d: std::array::from_fn(|i| self.d[i] - other.d[i]) }
    }
}

#[allow(clippy::suspicious_arithmetic_impl, reason = "the product rule is a sum")]
impl<S: Scalar, const N: usize> Mul for Dual<S, N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Dual {
            value: self.value * other.value,
            d: std::array::from_fn(|i| self.d[i] * other.value + self.value * other.d[i]),
        }
    }
}

#[allow(
    clippy::suspicious_arithmetic_impl,
    reason = "the quotient rule is a difference of products"
)]
impl<S: Scalar, const N: usize> Div for Dual<S, N> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Dual { value, d: std::array::from_fn(|i| (self.d[i] - value * other.d[i]) / other.value) }
    }
}

impl<S: Scalar, const N: usize> Neg for Dual<S, N> {
    type Output = Self;
    fn neg(self) -> Self {
        Dual { value: -self.value, d: self.d.map(|d| -d) }
    }
}

impl<S: Scalar, const N: usize> Scalar for Dual<S, N> {
    type Real = S::Real;
    fn constant(value: S::Real) -> Self {
        Dual::lift(S::constant(value))
    }
    fn real(self) -> S::Real {
        self.value.real()
    }
    fn sqrt(self) -> Self {
        let zero: S::Real = num_traits::Zero::zero();
        if self.real() == zero {
            return Dual::lift(S::constant(zero));
        }
        let root = self.value.sqrt();
        self.chain(root, S::constant(S::Real::of(0.5)) / root)
    }
    fn exp(self) -> Self {
        let e = self.value.exp();
        self.chain(e, e)
    }
    fn ln(self) -> Self {
        self.chain(self.value.ln(), S::constant(S::Real::of(1.0)) / self.value)
    }
    fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos())
    }
    fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    fn formula<S: Scalar>(x: S) -> S {
        (x * x + S::constant(S::Real::of(1.5))).sqrt().ln() * x.sin() / (x.cos().exp() + x.abs())
    }

    proptest! {
        #[test]
        fn first_and_second_derivatives_match_finite_differences(x in 0.1f64..2.5) {
            let h = 1e-4;
            let nested = formula(Dual::<_, 1>::variable(Dual::<f64, 1>::variable(x, 0), 0));
            let slope = (formula(x + h) - formula(x - h)) / (2.0 * h);
            let curvature = (formula(x + h) - 2.0 * formula(x) + formula(x - h)) / (h * h);
            assert_relative_eq!(nested.value.value, formula(x), epsilon = 1e-14);
            assert_relative_eq!(nested.d[0].value, slope, epsilon = 1e-6, max_relative = 1e-6);
            assert_relative_eq!(nested.value.d[0], slope, epsilon = 1e-6, max_relative = 1e-6);
            assert_relative_eq!(nested.d[0].d[0], curvature, epsilon = 1e-5, max_relative = 1e-5);
        }
    }

    #[test]
    fn square_root_has_derivative_zero_at_zero() {
        let root = Scalar::sqrt(Dual::<f64, 1>::variable(0.0, 0));
        assert_eq!((root.value, root.d[0]), (0.0, 0.0));
    }

    #[test]
    fn maximum_and_minimum_propagate_nan() {
        assert!(Scalar::max(f64::NAN, 1.0).is_nan());
        assert!(Scalar::min(f64::NAN, 1.0).is_nan());
        assert!(Scalar::min(1.0, f64::NAN).is_nan());
    }
}
