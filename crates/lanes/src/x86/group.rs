//! Numbers of a group of points in a register.

use std::arch::x86_64::*;
use std::ops::{Add, Mul, Sub};

use crate::group::{GROUP, Group};

/// Eight numbers.
///
/// The machine must have AVX2 and FMA. Only passes inside [`with_avx512`](super::with_avx512) and
/// [`with_avx2`](super::with_avx2) use this type. Their safety conditions include these
/// instructions.
#[allow(
    unreachable_pub,
    unnameable_types,
    reason = "an associated type of a public trait, which only a pass meets"
)]
#[derive(Clone, Copy, Debug)]
pub struct Eight(__m256);

/// Implements an operator of [`Eight`].
macro_rules! implement_operator {
    ($trait:ident, $function:ident, $instruction:ident) => {
        impl $trait for Eight {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                // SAFETY: the machine has the instruction: see `Eight`.
                unsafe { Eight($instruction(self.0, other.0)) }
            }
        }
    };
}

implement_operator!(Add, add, _mm256_add_ps);
implement_operator!(Sub, sub, _mm256_sub_ps);
implement_operator!(Mul, mul, _mm256_mul_ps);

impl Group<f32> for Eight {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: the machine has the instruction: see `Eight`.
        unsafe { Eight(_mm256_set1_ps(value)) }
    }
    #[inline(always)]
    fn load(from: &[f32; GROUP]) -> Self {
        // SAFETY: the machine has the instruction: see `Eight`. It needs no alignment.
        unsafe { Eight(_mm256_loadu_ps(from.as_ptr())) }
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; GROUP]) {
        // SAFETY: the machine has the instruction: see `Eight`. It needs no alignment.
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn fma(a: Self, b: Self, c: Self) -> Self {
        // SAFETY: the machine has the instruction: see `Eight`.
        unsafe { Eight(_mm256_fmadd_ps(a.0, b.0, c.0)) }
    }
    #[inline(always)]
    fn clamp(self, most: Self) -> Self {
        // SAFETY: the machine has the instructions: see `Eight`. For a NaN, `max` gives its second
        // number.
        unsafe { Eight(_mm256_min_ps(_mm256_max_ps(self.0, _mm256_setzero_ps()), most.0)) }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: the machine has the instruction: see `Eight`.
        unsafe { Eight(_mm256_min_ps(self.0, other.0)) }
    }
    #[inline(always)]
    fn where_equal(self, a: Self, b: Self) -> Self {
        // SAFETY: the machine has the instructions: see `Eight`.
        unsafe { Eight(_mm256_and_ps(_mm256_cmp_ps::<_CMP_EQ_OQ>(a.0, b.0), self.0)) }
    }
    #[inline(always)]
    fn truncate(self) -> ([u32; GROUP], Self) {
        let mut whole = [0; GROUP];
        // SAFETY: the machine has the instructions: see `Eight`. The array has as many bytes as a
        // register, and the store needs no alignment.
        unsafe {
            let integers = _mm256_cvttps_epi32(self.0);
            _mm256_storeu_si256(whole.as_mut_ptr().cast(), integers);
            (whole, Eight(_mm256_cvtepi32_ps(integers)))
        }
    }
}
