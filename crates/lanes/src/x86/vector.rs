//! Vector registers of 16 and of 8 numbers behind one trait.

use std::arch::x86_64::*;

/// A register of `N` numbers.
///
/// The machine must have its instructions: AVX-512 F for `__m512`, AVX2 and FMA for `__m256`. Only
/// the kernels of this folder use the trait. They run only inside
/// [`with_avx512`](super::with_avx512) and [`with_avx2`](super::with_avx2), whose safety conditions
/// include these instructions.
pub(super) trait Vector: Copy {
    /// The number of numbers in a register.
    const N: usize;
    /// `N` copies of a number.
    fn splat(value: f32) -> Self;
    /// The first `N` numbers of `from`.
    ///
    /// # Panics
    /// If `from` is shorter.
    fn load(from: &[f32]) -> Self;
    /// Writes the first `N` numbers of `to`.
    ///
    /// # Panics
    /// If `to` is shorter.
    fn store(self, to: &mut [f32]);
    /// a b + c, rounded once.
    fn fma(a: Self, b: Self, c: Self) -> Self;
    /// a + b.
    fn add(a: Self, b: Self) -> Self;
    /// Transposes a square of `N` rows.
    fn transpose(rows: &mut [Self]);
}

/// Implements [`Vector`] for a register type with the intrinsics of its width.
///
/// `transpose` first transposes 4 × 4 squares inside every four rows; `$exchange` then moves these
/// squares to their places.
macro_rules! implement_vector {
    ($type:ty, $n:literal, $splat:ident, $load:ident, $store:ident, $fma:ident, $add:ident,
     $low:ident, $high:ident, $shuffle:ident, $exchange:ident) => {
        impl Vector for $type {
            const N: usize = $n;

            #[inline(always)]
            fn splat(value: f32) -> Self {
                // SAFETY: the machine has the instruction: see `Vector`.
                unsafe { $splat(value) }
            }
            #[inline(always)]
            fn load(from: &[f32]) -> Self {
                let from = &from[..$n];
                // SAFETY: the machine has the instruction: see `Vector`. The slice has N numbers,
                // and the load needs no alignment.
                unsafe { $load(from.as_ptr()) }
            }
            #[inline(always)]
            fn store(self, to: &mut [f32]) {
                let to = &mut to[..$n];
                // SAFETY: the machine has the instruction: see `Vector`. The slice has N numbers,
                // and the store needs no alignment.
                unsafe { $store(to.as_mut_ptr(), self) }
            }
            #[inline(always)]
            fn fma(a: Self, b: Self, c: Self) -> Self {
                // SAFETY: the machine has the instruction: see `Vector`.
                unsafe { $fma(a, b, c) }
            }
            #[inline(always)]
            fn add(a: Self, b: Self) -> Self {
                // SAFETY: the machine has the instruction: see `Vector`.
                unsafe { $add(a, b) }
            }
            #[inline(always)]
            fn transpose(rows: &mut [Self]) {
                for four in rows.chunks_exact_mut(4) {
                    // SAFETY: the machine has the instructions: see `Vector`.
                    unsafe {
                        let (a, b) = ($low(four[0], four[1]), $high(four[0], four[1]));
                        let (c, d) = ($low(four[2], four[3]), $high(four[2], four[3]));
                        four[0] = $shuffle::<0x44>(a, c);
                        four[1] = $shuffle::<0xee>(a, c);
                        four[2] = $shuffle::<0x44>(b, d);
                        four[3] = $shuffle::<0xee>(b, d);
                    }
                }
                for c in 0..4 {
                    $exchange(rows, c);
                }
            }
        }
    };
}

implement_vector!(
    __m512,
    16,
    _mm512_set1_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    _mm512_fmadd_ps,
    _mm512_add_ps,
    _mm512_unpacklo_ps,
    _mm512_unpackhi_ps,
    _mm512_shuffle_ps,
    exchange_512
);
implement_vector!(
    __m256,
    8,
    _mm256_set1_ps,
    _mm256_loadu_ps,
    _mm256_storeu_ps,
    _mm256_fmadd_ps,
    _mm256_add_ps,
    _mm256_unpacklo_ps,
    _mm256_unpackhi_ps,
    _mm256_shuffle_ps,
    exchange_256
);

/// Moves the 4 × 4 squares of rows c, 4 + c, 8 + c and 12 + c to their transposed places.
#[inline(always)]
fn exchange_512(rows: &mut [__m512], c: usize) {
    // SAFETY: the machine has AVX-512 F: see `Vector`.
    unsafe {
        let a = _mm512_shuffle_f32x4::<0x44>(rows[c], rows[4 + c]);
        let b = _mm512_shuffle_f32x4::<0xee>(rows[c], rows[4 + c]);
        let d = _mm512_shuffle_f32x4::<0x44>(rows[8 + c], rows[12 + c]);
        let e = _mm512_shuffle_f32x4::<0xee>(rows[8 + c], rows[12 + c]);
        rows[c] = _mm512_shuffle_f32x4::<0x88>(a, d);
        rows[4 + c] = _mm512_shuffle_f32x4::<0xdd>(a, d);
        rows[8 + c] = _mm512_shuffle_f32x4::<0x88>(b, e);
        rows[12 + c] = _mm512_shuffle_f32x4::<0xdd>(b, e);
    }
}

/// Moves the 4 × 4 squares of rows c and 4 + c to their transposed places.
#[inline(always)]
fn exchange_256(rows: &mut [__m256], c: usize) {
    // SAFETY: the machine has AVX2: see `Vector`.
    unsafe {
        let (a, b) = (rows[c], rows[4 + c]);
        rows[c] = _mm256_permute2f128_ps::<0x20>(a, b);
        rows[4 + c] = _mm256_permute2f128_ps::<0x31>(a, b);
    }
}
