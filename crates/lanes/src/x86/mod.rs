//! AVX-512 and AVX2 in single precision, for machines that have them.
//!
//! A pass reaches these kernels only through [`with_avx512`] and [`with_avx2`], which are compiled
//! for the instructions. Their callers detect the instructions first.

mod group;
mod kernels;
mod softplus;
mod vector;

use std::arch::x86_64::{__m256, __m512};

use self::group::Eight;
use self::kernels::{multiply, multiply_few, outer, sum_rows, transpose};
use self::softplus::softplus;
use super::block::{HALF, Row, Softplus, TILE};
use super::group::GROUP;
use super::isa::{Isa, Pass};
use super::table::{Sums, TableRows};

/// Whether this machine has the instructions of [`with_avx512`].
pub(super) fn has_avx512() -> bool {
    has_avx2()
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512vl")
}

/// Whether this machine has the instructions of [`with_avx2`].
pub(super) fn has_avx2() -> bool {
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("fma")
        && is_x86_feature_detected!("popcnt")
}

/// Runs a pass with AVX-512.
///
/// # Safety
/// The machine must have AVX2, FMA, POPCNT and AVX-512 F, DQ, BW and VL.
#[target_feature(enable = "avx2,fma,popcnt,avx512f,avx512dq,avx512bw,avx512vl")]
#[inline(never)]
pub(super) unsafe fn with_avx512<P: Pass>(pass: P) {
    pass.run::<Avx512>();
}

/// Runs a pass with AVX2.
///
/// # Safety
/// The machine must have AVX2, FMA and POPCNT.
#[target_feature(enable = "avx2,fma,popcnt")]
#[inline(never)]
pub(super) unsafe fn with_avx2<P: Pass>(pass: P) {
    pass.run::<Avx2>();
}

/// 512-bit vectors. Only [`with_avx512`] uses this type: its kernels need the instructions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Avx512;

/// 256-bit vectors. Only [`with_avx2`] uses this type: its kernels need the instructions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Avx2;

impl Isa for Avx512 {
    const FMA: bool = true;

    type Group = Eight;

    #[inline(always)]
    fn call<P: Pass>(part: P) {
        // SAFETY: only `with_avx512` uses this type, so its caller detected the instructions.
        unsafe { with_avx512(part) }
    }

    // Sixteen sums in registers (eight for half a block): a fused multiply–add takes 4 cycles and 2
    // start in each cycle, so at least 8 independent sums keep both units busy.
    #[inline(always)]
    fn multiply<const N: usize>(
        packed: &[[f32; TILE]],
        start: &[f32],
        rows: usize,
        input: &[Row<f32>],
        output: &mut [Row<f32>],
    ) {
        if N <= GROUP {
            multiply::<__m256, N, 8, 1>(packed, start, rows, input, output);
        } else if N <= HALF {
            multiply::<__m512, N, 8, 1>(packed, start, rows, input, output);
        } else {
            multiply::<__m512, N, 8, 2>(packed, start, rows, input, output);
        }
    }
    #[inline(always)]
    fn multiply_few<const P: usize>(
        columns: &[Row<f32>],
        start: &[Row<f32>],
        input: [&[Row<f32>]; P],
        output: &mut [Row<f32>],
    ) {
        multiply_few::<__m512, P, 2>(columns, start, input, output);
    }
    #[inline(always)]
    fn outer(sides: &[(&[Row<f32>], &[f32])], rows: usize, columns: usize, gradient: &mut [f32]) {
        outer::<__m512, 8, 2>(sides, rows, columns, gradient);
    }
    #[inline(always)]
    fn transpose(rows: &[Row<f32>], out: &mut [f32]) {
        transpose::<__m512, 16>(rows, out);
    }
    #[inline(always)]
    fn softplus<const N: usize, const STORE: bool, const TANGENT: bool>(
        beta: f64,
        z: &Row<f32>,
        out: Softplus<'_, f32>,
    ) {
        if N <= GROUP {
            softplus::<__m256, N, STORE, TANGENT>(beta, z, out);
        } else {
            softplus::<__m512, N, STORE, TANGENT>(beta, z, out);
        }
    }
    // A row has eight entries.
    #[inline(always)]
    fn sum_rows<const T: usize, const ORDER: usize>(
        rows: &TableRows<'_, f32, T>,
        sums: &mut Sums<f32>,
    ) {
        sum_rows::<__m256, T, ORDER>(rows, sums);
    }
}

impl Isa for Avx2 {
    const FMA: bool = true;

    type Group = Eight;

    #[inline(always)]
    fn call<P: Pass>(part: P) {
        // SAFETY: only `with_avx2` uses this type, so its caller detected the instructions.
        unsafe { with_avx2(part) }
    }

    // Eight sums: AVX2 has 16 registers.
    #[inline(always)]
    fn multiply<const N: usize>(
        packed: &[[f32; TILE]],
        start: &[f32],
        rows: usize,
        input: &[Row<f32>],
        output: &mut [Row<f32>],
    ) {
        if N <= GROUP {
            multiply::<__m256, N, 8, 1>(packed, start, rows, input, output);
        } else {
            multiply::<__m256, N, 4, 2>(packed, start, rows, input, output);
        }
    }
    #[inline(always)]
    fn multiply_few<const P: usize>(
        columns: &[Row<f32>],
        start: &[Row<f32>],
        input: [&[Row<f32>]; P],
        output: &mut [Row<f32>],
    ) {
        multiply_few::<__m256, P, 2>(columns, start, input, output);
    }
    #[inline(always)]
    fn outer(sides: &[(&[Row<f32>], &[f32])], rows: usize, columns: usize, gradient: &mut [f32]) {
        outer::<__m256, 4, 2>(sides, rows, columns, gradient);
    }
    #[inline(always)]
    fn transpose(rows: &[Row<f32>], out: &mut [f32]) {
        transpose::<__m256, 8>(rows, out);
    }
    #[inline(always)]
    fn softplus<const N: usize, const STORE: bool, const TANGENT: bool>(
        beta: f64,
        z: &Row<f32>,
        out: Softplus<'_, f32>,
    ) {
        softplus::<__m256, N, STORE, TANGENT>(beta, z, out);
    }
    #[inline(always)]
    fn sum_rows<const T: usize, const ORDER: usize>(
        rows: &TableRows<'_, f32, T>,
        sums: &mut Sums<f32>,
    ) {
        sum_rows::<__m256, T, ORDER>(rows, sums);
    }
}
