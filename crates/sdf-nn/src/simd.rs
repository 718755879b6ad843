//! Instruction sets and their vectors: the one place of the crate that needs `unsafe`.
#![allow(
    unsafe_code,
    reason = "vector instructions, and functions compiled for instructions that were checked for at run time"
)]

use crate::kernel::{HALF, LANES, Row, TILE, multiply_rows, outer_rows, transpose_lanes};

/// An instruction set that kernels are compiled for.
pub trait Isa: Copy {
    /// Whether a fused multiply–add is an instruction. Where it is not, it would be a slow library
    /// call.
    const FMA: bool;

    /// As [`crate::kernel::multiply_rows`].
    fn multiply<const N: usize>(
        packed: &[[f32; TILE]],
        start: &[f32],
        rows: usize,
        input: &[Row<f32>],
        output: &mut [Row<f32>],
    );
    /// As [`crate::kernel::outer_rows`].
    fn outer(sides: &[(&[Row<f32>], &[f32])], rows: usize, columns: usize, gradient: &mut [f32]);
    /// As [`crate::kernel::transpose_lanes`].
    fn transpose(rows: &[Row<f32>], out: &mut [f32]);
}

/// What every machine has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Isa for Portable {
    const FMA: bool = cfg!(target_arch = "aarch64");

    #[inline(always)]
    fn multiply<const N: usize>(
        packed: &[[f32; TILE]],
        start: &[f32],
        rows: usize,
        input: &[Row<f32>],
        output: &mut [Row<f32>],
    ) {
        multiply_rows::<f32, Self, N>(packed, start, rows, input, output);
    }
    #[inline(always)]
    fn outer(sides: &[(&[Row<f32>], &[f32])], rows: usize, columns: usize, gradient: &mut [f32]) {
        outer_rows::<f32, Self>(sides, rows, columns, gradient);
    }
    #[inline(always)]
    fn transpose(rows: &[Row<f32>], out: &mut [f32]) {
        transpose_lanes(rows, out);
    }
}

/// A computation over a batch, generic over the instruction set.
///
/// Implementations mark `run` `#[inline(always)]`, so that all of it is compiled for the
/// instruction set.
pub(crate) trait Pass {
    /// Does it.
    fn run<I: Isa>(self);
}

/// Runs a pass with the widest instructions this machine has.
pub(crate) fn dispatch<P: Pass>(pass: P) {
    #[cfg(target_arch = "x86_64")]
    {
        if x86::has_avx512() {
            // SAFETY: the instructions that the function is compiled for are present.
            unsafe { x86::with_avx512(pass) };
            return;
        }
        if x86::has_avx2() {
            // SAFETY: as above.
            unsafe { x86::with_avx2(pass) };
            return;
        }
    }
    pass.run::<Portable>();
}

/// Runs a pass with every instruction set of this machine, widest first.
#[cfg(test)]
pub(crate) fn dispatch_all<P: Pass>(mut pass: impl FnMut(&'static str) -> P) {
    #[cfg(target_arch = "x86_64")]
    {
        if x86::has_avx512() {
            // SAFETY: the instructions that the function is compiled for are present.
            unsafe { x86::with_avx512(pass("AVX-512")) };
        }
        if x86::has_avx2() {
            // SAFETY: as above.
            unsafe { x86::with_avx2(pass("AVX2")) };
        }
    }
    pass("portable").run::<Portable>();
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::{HALF, Isa, LANES, Pass, Row, TILE};
    use crate::kernel::padded;

    pub(super) fn has_avx512() -> bool {
        has_avx2()
            && is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512vl")
    }

    pub(super) fn has_avx2() -> bool {
        is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
    }

    /// # Safety
    /// The machine must have AVX-512 F, DQ, BW and VL.
    #[target_feature(enable = "avx2,fma,avx512f,avx512dq,avx512bw,avx512vl")]
    pub(super) unsafe fn with_avx512<P: Pass>(pass: P) {
        pass.run::<Avx512>();
    }

    /// # Safety
    /// The machine must have AVX2 and FMA.
    #[target_feature(enable = "avx2,fma")]
    pub(super) unsafe fn with_avx2<P: Pass>(pass: P) {
        pass.run::<Avx2>();
    }

    /// 512-bit vectors. Only [`with_avx512`] names it.
    #[derive(Clone, Copy, Debug)]
    pub(super) struct Avx512;

    /// 256-bit vectors. Only [`with_avx2`] names it.
    #[derive(Clone, Copy, Debug)]
    pub(super) struct Avx2;

    impl Isa for Avx512 {
        const FMA: bool = true;

        // Sixteen chains of fused multiply–adds: they take 4 cycles and 2 start in each.
        #[inline(always)]
        fn multiply<const N: usize>(
            packed: &[[f32; TILE]],
            start: &[f32],
            rows: usize,
            input: &[Row<f32>],
            output: &mut [Row<f32>],
        ) {
            if N <= HALF {
                multiply::<__m512, N, 8, 1>(packed, start, rows, input, output);
            } else {
                multiply::<__m512, N, 8, 2>(packed, start, rows, input, output);
            }
        }
        #[inline(always)]
        fn outer(
            sides: &[(&[Row<f32>], &[f32])],
            rows: usize,
            columns: usize,
            gradient: &mut [f32],
        ) {
            outer::<__m512, 8, 2>(sides, rows, columns, gradient);
        }
        #[inline(always)]
        fn transpose(rows: &[Row<f32>], out: &mut [f32]) {
            transpose::<__m512, 16>(rows, out);
        }
    }

    impl Isa for Avx2 {
        const FMA: bool = true;

        // Eight chains: there are sixteen registers.
        #[inline(always)]
        fn multiply<const N: usize>(
            packed: &[[f32; TILE]],
            start: &[f32],
            rows: usize,
            input: &[Row<f32>],
            output: &mut [Row<f32>],
        ) {
            multiply::<__m256, N, 4, 2>(packed, start, rows, input, output);
        }
        #[inline(always)]
        fn outer(
            sides: &[(&[Row<f32>], &[f32])],
            rows: usize,
            columns: usize,
            gradient: &mut [f32],
        ) {
            outer::<__m256, 4, 2>(sides, rows, columns, gradient);
        }
        #[inline(always)]
        fn transpose(rows: &[Row<f32>], out: &mut [f32]) {
            transpose::<__m256, 8>(rows, out);
        }
    }

    /// A register of `N` numbers. Its functions may run only where its instructions are present:
    /// they are called from kernels that [`Isa`] chooses, inside functions compiled for these
    /// instructions.
    trait Vector: Copy {
        const N: usize;
        fn splat(value: f32) -> Self;
        /// From `N` numbers.
        fn load(from: &[f32]) -> Self;
        /// To `N` numbers.
        fn store(self, to: &mut [f32]);
        /// a b + c.
        fn fma(a: Self, b: Self, c: Self) -> Self;
        fn add(a: Self, b: Self) -> Self;
        /// Transposes the first `N` rows.
        fn transpose(rows: &mut [Self]);
    }

    /// What both widths have alike, and the transposition of the squares of 4 × 4 along the
    /// diagonals of four rows.
    macro_rules! vector {
        ($type:ty, $n:literal, $splat:ident, $load:ident, $store:ident, $fma:ident, $add:ident,
         $low:ident, $high:ident, $shuffle:ident, $exchange:ident) => {
            impl Vector for $type {
                const N: usize = $n;

                #[inline(always)]
                fn splat(value: f32) -> Self {
                    // SAFETY: see the trait; so for all below.
                    unsafe { $splat(value) }
                }
                #[inline(always)]
                fn load(from: &[f32]) -> Self {
                    let from = &from[..$n];
                    // SAFETY: N numbers are there.
                    unsafe { $load(from.as_ptr()) }
                }
                #[inline(always)]
                fn store(self, to: &mut [f32]) {
                    let to = &mut to[..$n];
                    // SAFETY: there is room for N numbers.
                    unsafe { $store(to.as_mut_ptr(), self) }
                }
                #[inline(always)]
                fn fma(a: Self, b: Self, c: Self) -> Self {
                    unsafe { $fma(a, b, c) }
                }
                #[inline(always)]
                fn add(a: Self, b: Self) -> Self {
                    unsafe { $add(a, b) }
                }
                #[inline(always)]
                fn transpose(rows: &mut [Self]) {
                    for four in rows.chunks_exact_mut(4) {
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

    vector!(
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
    vector!(
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

    /// Transposes the blocks of four of rows c, 4 + c, 8 + c and 12 + c.
    #[inline(always)]
    fn exchange_512(rows: &mut [__m512], c: usize) {
        // SAFETY: see `Vector`; so below.
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

    /// Transposes the blocks of four of rows c and 4 + c.
    #[inline(always)]
    fn exchange_256(rows: &mut [__m256], c: usize) {
        unsafe {
            let (a, b) = (rows[c], rows[4 + c]);
            rows[c] = _mm256_permute2f128_ps::<0x20>(a, b);
            rows[4 + c] = _mm256_permute2f128_ps::<0x31>(a, b);
        }
    }

    /// [`crate::kernel::multiply_rows`] with `ROWS` × `REGS` sums in registers.
    #[inline(always)]
    fn multiply<V: Vector, const N: usize, const ROWS: usize, const REGS: usize>(
        packed: &[[f32; TILE]],
        start: &[f32],
        rows: usize,
        input: &[Row<f32>],
        output: &mut [Row<f32>],
    ) {
        let n = input.len();
        for (tile, out) in output.chunks_exact_mut(TILE).enumerate().take(rows.div_ceil(TILE)) {
            let weights = &packed[tile * n..(tile + 1) * n];
            let start = start.get(tile * TILE..).unwrap_or(&[]);
            if rows - tile * TILE == 1 {
                block::<V, N, 1, REGS>(weights, start, 0, input, out);
                continue;
            }
            for first in (0..TILE).step_by(ROWS) {
                block::<V, N, ROWS, REGS>(weights, start, first, input, out);
            }
        }
    }

    /// `ROWS` rows of a tile, from row `first`.
    #[inline(always)]
    fn block<V: Vector, const N: usize, const ROWS: usize, const REGS: usize>(
        weights: &[[f32; TILE]],
        start: &[f32],
        first: usize,
        input: &[Row<f32>],
        out: &mut [Row<f32>],
    ) {
        for lane in (0..N).step_by(REGS * V::N) {
            let mut sums: [[V; REGS]; ROWS] = std::array::from_fn(|r| {
                [V::splat(start.get(first + r).copied().unwrap_or(0.0)); REGS]
            });
            for (w, x) in weights.iter().zip(input) {
                let x: [V; REGS] = std::array::from_fn(|v| V::load(&x.0[lane + v * V::N..]));
                for r in 0..ROWS {
                    let w = V::splat(w[first + r]);
                    for v in 0..REGS {
                        sums[r][v] = V::fma(w, x[v], sums[r][v]);
                    }
                }
            }
            for r in 0..ROWS {
                for v in 0..REGS {
                    sums[r][v].store(&mut out[first + r].0[lane + v * V::N..]);
                }
            }
        }
    }

    /// [`crate::kernel::outer_rows`] with `ROWS` × `REGS` sums in registers.
    #[inline(always)]
    fn outer<V: Vector, const ROWS: usize, const REGS: usize>(
        sides: &[(&[Row<f32>], &[f32])],
        rows: usize,
        columns: usize,
        gradient: &mut [f32],
    ) {
        let stride = padded(columns);
        for (tile, out) in
            gradient.chunks_exact_mut(ROWS * stride).enumerate().take(rows.div_ceil(ROWS))
        {
            let first = tile * ROWS;
            let mut column = 0;
            while column < stride {
                let wide = column + REGS * V::N <= stride;
                match (rows - first, wide) {
                    (1, true) => sums::<V, 1, REGS>(sides, first, column, stride, out),
                    (1, false) => sums::<V, 1, 1>(sides, first, column, stride, out),
                    (_, true) => sums::<V, ROWS, REGS>(sides, first, column, stride, out),
                    (_, false) => sums::<V, ROWS, 1>(sides, first, column, stride, out),
                }
                column += if wide { REGS * V::N } else { V::N };
            }
        }
    }

    /// `ROWS` rows of a weight gradient from row `first`, and `REGS` registers of its columns from
    /// `column`.
    #[inline(always)]
    fn sums<V: Vector, const ROWS: usize, const REGS: usize>(
        sides: &[(&[Row<f32>], &[f32])],
        first: usize,
        column: usize,
        stride: usize,
        out: &mut [f32],
    ) {
        let mut sums = [[V::splat(0.0); REGS]; ROWS];
        for (adjoint, input) in sides {
            let adjoint = &adjoint[first..first + ROWS];
            for (l, input) in input.chunks_exact(stride).enumerate().take(LANES) {
                let x: [V; REGS] = std::array::from_fn(|v| V::load(&input[column + v * V::N..]));
                for r in 0..ROWS {
                    let a = V::splat(adjoint[r].0[l]);
                    for v in 0..REGS {
                        sums[r][v] = V::fma(a, x[v], sums[r][v]);
                    }
                }
            }
        }
        for r in 0..ROWS {
            for v in 0..REGS {
                let place = &mut out[r * stride + column + v * V::N..];
                V::add(V::load(place), sums[r][v]).store(place);
            }
        }
    }

    /// [`crate::kernel::transpose_lanes`] in squares of `N` = `V::N`.
    #[inline(always)]
    fn transpose<V: Vector, const N: usize>(rows: &[Row<f32>], out: &mut [f32]) {
        let stride = padded(rows.len());
        for first in (0..rows.len()).step_by(N) {
            for lane in (0..LANES).step_by(N) {
                let mut square: [V; N] = std::array::from_fn(|r| {
                    rows.get(first + r).map_or(V::splat(0.0), |row| V::load(&row.0[lane..]))
                });
                V::transpose(&mut square);
                for (l, column) in square.into_iter().enumerate() {
                    column.store(&mut out[(lane + l) * stride + first..]);
                }
            }
        }
    }
}
