//! Kernels on blocks of points, compiled for each instruction set. No other module of the library
//! has `unsafe`.
//!
//! - [`block`]: blocks of points as rows of lanes, and packed weights.
//! - [`portable`]: the kernels for any machine and both precisions.
//! - `x86`: the kernels for AVX-512 and AVX2 in single precision.
//!
//! All kernels add in the same order. All functions below a [`Pass`] are `#[inline(always)]`, so
//! that a pass is compiled as a whole for each instruction set.
#![allow(
    unsafe_code,
    reason = "vector instructions, and calls of functions compiled for instructions that were \
              detected at run time"
)]

mod block;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(crate) use block::{HALF, LANES, Row, TILE, fma, pack, padded};
pub(crate) use portable::{Portable, multiply_rows, outer_rows, transpose_lanes};

/// An instruction set that kernels are compiled for.
pub trait Isa: Copy {
    /// Whether a fused multiply–add is one instruction. Elsewhere it would be a slow library call.
    const FMA: bool;

    /// The matrix product of [`multiply_rows`].
    fn multiply<const N: usize>(
        packed: &[[f32; TILE]],
        start: &[f32],
        rows: usize,
        input: &[Row<f32>],
        output: &mut [Row<f32>],
    );
    /// The sum of outer products of [`outer_rows`].
    fn outer(sides: &[(&[Row<f32>], &[f32])], rows: usize, columns: usize, gradient: &mut [f32]);
    /// The transposition of [`transpose_lanes`].
    fn transpose(rows: &[Row<f32>], out: &mut [f32]);
}

/// A computation over a batch, generic over the instruction set.
///
/// Implementations mark `run` with `#[inline(always)]`: all of it is then compiled for the
/// instruction set.
pub(crate) trait Pass {
    /// Runs the computation with the instructions of `I`.
    fn run<I: Isa>(self);
}

/// Runs a pass with the widest vectors of this machine.
pub(crate) fn dispatch<P: Pass>(pass: P) {
    #[cfg(target_arch = "x86_64")]
    {
        if x86::has_avx512() {
            // SAFETY: `has_avx512` detected every instruction set that `with_avx512` needs.
            unsafe { x86::with_avx512(pass) };
            return;
        }
        if x86::has_avx2() {
            // SAFETY: `has_avx2` detected every instruction set that `with_avx2` needs.
            unsafe { x86::with_avx2(pass) };
            return;
        }
    }
    pass.run::<Portable>();
}

/// Runs a pass with every instruction set of this machine, widest vectors first.
#[cfg(test)]
pub(crate) fn dispatch_all<P: Pass>(mut pass: impl FnMut(&'static str) -> P) {
    #[cfg(target_arch = "x86_64")]
    {
        if x86::has_avx512() {
            // SAFETY: `has_avx512` detected every instruction set that `with_avx512` needs.
            unsafe { x86::with_avx512(pass("AVX-512")) };
        }
        if x86::has_avx2() {
            // SAFETY: `has_avx2` detected every instruction set that `with_avx2` needs.
            unsafe { x86::with_avx2(pass("AVX2")) };
        }
    }
    pass("portable").run::<Portable>();
}
