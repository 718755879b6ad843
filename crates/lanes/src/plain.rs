//! Numbers of a group of points without explicit vectors.

use std::marker::PhantomData;
use std::ops::{Add, Mul, Sub};

use field::Real;

use super::group::{GROUP, Group};
use super::isa::{Isa, fma};

/// [`Group`] without explicit vectors.
#[derive(Clone, Copy, Debug)]
pub struct Plain<R, I>([R; GROUP], PhantomData<I>);

/// Implements an operator of [`Plain`].
macro_rules! implement_operator {
    ($trait:ident, $function:ident) => {
        impl<R: Real, I: Isa> $trait for Plain<R, I> {
            type Output = Self;

            #[inline(always)]
            fn $function(mut self, other: Self) -> Self {
                for l in 0..GROUP {
                    self.0[l] = self.0[l].$function(other.0[l]);
                }
                self
            }
        }
    };
}

implement_operator!(Add, add);
implement_operator!(Sub, sub);
implement_operator!(Mul, mul);

impl<R: Real, I: Isa> Group<R> for Plain<R, I> {
    #[inline(always)]
    fn splat(value: R) -> Self {
        Plain([value; GROUP], PhantomData)
    }
    #[inline(always)]
    fn load(from: &[R; GROUP]) -> Self {
        Plain(*from, PhantomData)
    }
    #[inline(always)]
    fn store(self, to: &mut [R; GROUP]) {
        *to = self.0;
    }
    #[inline(always)]
    fn fma(a: Self, b: Self, mut c: Self) -> Self {
        for l in 0..GROUP {
            c.0[l] = fma::<R, I>(a.0[l], b.0[l], c.0[l]);
        }
        c
    }
    #[inline(always)]
    fn clamp(mut self, most: Self) -> Self {
        for l in 0..GROUP {
            let positive = if self.0[l] > R::zero() { self.0[l] } else { R::zero() };
            self.0[l] = if positive < most.0[l] { positive } else { most.0[l] };
        }
        self
    }
    #[inline(always)]
    fn min(mut self, other: Self) -> Self {
        for l in 0..GROUP {
            self.0[l] = if self.0[l] < other.0[l] { self.0[l] } else { other.0[l] };
        }
        self
    }
    #[inline(always)]
    fn where_equal(mut self, a: Self, b: Self) -> Self {
        for l in 0..GROUP {
            self.0[l] = if a.0[l] == b.0[l] { self.0[l] } else { R::zero() };
        }
        self
    }
    #[inline(always)]
    fn truncate(mut self) -> ([u32; GROUP], Self) {
        let mut whole = [0; GROUP];
        for l in 0..GROUP {
            whole[l] = self.0[l].to_u32().unwrap_or(0);
            self.0[l] = R::of(f64::from(whole[l]));
        }
        (whole, self)
    }
}
