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
    /// a b − c, rounded once.
    fn fused_difference(a: Self, b: Self, c: Self) -> Self;
    /// a + b.
    fn add(a: Self, b: Self) -> Self;
    /// a − b.
    fn sub(a: Self, b: Self) -> Self;
    /// a b.
    fn mul(a: Self, b: Self) -> Self;
    /// a/b.
    fn div(a: Self, b: Self) -> Self;
    /// The lesser of a and b; b if one is a NaN.
    fn min(a: Self, b: Self) -> Self;
    /// The greater of a and b; b if one is a NaN.
    fn max(a: Self, b: Self) -> Self;
    /// |a|.
    fn abs(a: Self) -> Self;
    /// p 2ⁿ, where the low bits of `shifted` are n. The results must be normal numbers.
    fn scale(p: Self, shifted: Self) -> Self;
    /// `then` where a > 0, and `otherwise` elsewhere.
    fn where_positive(a: Self, then: Self, otherwise: Self) -> Self;
    /// Transposes a square of `N` rows.
    fn transpose(rows: &mut [Self]);
}

/// Implements [`Vector`] for a register type with the intrinsics of its width.
///
/// `transpose` first transposes 4 × 4 squares inside every four rows; `$exchange` then moves these
/// squares to their places.
macro_rules! implement_vector {
    ($type:ty, $n:literal, $splat:ident, $load:ident, $store:ident, $fma:ident,
     $fused_difference:ident, [$($name:ident: $binary:ident),*], $abs:ident, $scale:ident,
     $where_positive:ident, $low:ident, $high:ident, $shuffle:ident, $exchange:ident) => {
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
            fn fused_difference(a: Self, b: Self, c: Self) -> Self {
                // SAFETY: the machine has the instruction: see `Vector`.
                unsafe { $fused_difference(a, b, c) }
            }
            $(
                #[inline(always)]
                fn $name(a: Self, b: Self) -> Self {
                    // SAFETY: the machine has the instruction: see `Vector`.
                    unsafe { $binary(a, b) }
                }
            )*
            #[inline(always)]
            fn abs(a: Self) -> Self {
                $abs(a)
            }
            #[inline(always)]
            fn scale(p: Self, shifted: Self) -> Self {
                $scale(p, shifted)
            }
            #[inline(always)]
            fn where_positive(a: Self, then: Self, otherwise: Self) -> Self {
                $where_positive(a, then, otherwise)
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
    _mm512_fmsub_ps,
    [
        add: _mm512_add_ps,
        sub: _mm512_sub_ps,
        mul: _mm512_mul_ps,
        div: _mm512_div_ps,
        min: _mm512_min_ps,
        max: _mm512_max_ps
    ],
    abs_512,
    scale_512,
    where_positive_512,
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
    _mm256_fmsub_ps,
    [
        add: _mm256_add_ps,
        sub: _mm256_sub_ps,
        mul: _mm256_mul_ps,
        div: _mm256_div_ps,
        min: _mm256_min_ps,
        max: _mm256_max_ps
    ],
    abs_256,
    scale_256,
    where_positive_256,
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

/// |a|.
#[inline(always)]
fn abs_512(a: __m512) -> __m512 {
    // SAFETY: the machine has AVX-512 F: see `Vector`.
    unsafe { _mm512_abs_ps(a) }
}

/// |a|.
#[inline(always)]
fn abs_256(a: __m256) -> __m256 {
    // SAFETY: the machine has AVX2: see `Vector`.
    unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), a) }
}

/// Adds the low bits of `shifted` to the exponent of p.
#[inline(always)]
fn scale_512(p: __m512, shifted: __m512) -> __m512 {
    // SAFETY: the machine has AVX-512 F: see `Vector`.
    unsafe {
        let exponent = _mm512_slli_epi32::<23>(_mm512_castps_si512(shifted));
        _mm512_castsi512_ps(_mm512_add_epi32(_mm512_castps_si512(p), exponent))
    }
}

/// Adds the low bits of `shifted` to the exponent of p.
#[inline(always)]
fn scale_256(p: __m256, shifted: __m256) -> __m256 {
    // SAFETY: the machine has AVX2: see `Vector`.
    unsafe {
        let exponent = _mm256_slli_epi32::<23>(_mm256_castps_si256(shifted));
        _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(p), exponent))
    }
}

/// `then` where a > 0, and `otherwise` elsewhere.
#[inline(always)]
fn where_positive_512(a: __m512, then: __m512, otherwise: __m512) -> __m512 {
    // SAFETY: the machine has AVX-512 F: see `Vector`.
    unsafe {
        let is_positive = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(a, _mm512_setzero_ps());
        _mm512_mask_blend_ps(is_positive, otherwise, then)
    }
}

/// `then` where a > 0, and `otherwise` elsewhere.
#[inline(always)]
fn where_positive_256(a: __m256, then: __m256, otherwise: __m256) -> __m256 {
    // SAFETY: the machine has AVX2: see `Vector`.
    unsafe {
        let is_positive = _mm256_cmp_ps::<_CMP_GT_OQ>(a, _mm256_setzero_ps());
        _mm256_blendv_ps(otherwise, then, is_positive)
    }
}
