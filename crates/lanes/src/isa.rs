//! Instruction sets, and computations that are compiled for each.

use field::Real;

use super::block::{Row, TILE};
use super::portable;

/// An instruction set that kernels are compiled for. The provided kernels have no explicit vectors.
pub trait Isa: Copy {
    /// Whether a fused multiply–add is one instruction. Elsewhere it would be a slow library call.
    const FMA: bool;

    /// Runs a part of a pass with these instructions, as a function of its own. All passes that
    /// have the part share its code; a call takes a few nanoseconds.
    fn call<P: Pass>(part: P);

    /// The matrix product of [`crate::multiply`].
    #[inline(always)]
    fn multiply<const N: usize>(
        packed: &[[f32; TILE]],
        start: &[f32],
        rows: usize,
        input: &[Row<f32>],
        output: &mut [Row<f32>],
    ) {
        portable::multiply::<f32, Self, N>(packed, start, rows, input, output);
    }
    /// The matrix product of [`crate::multiply_few`].
    #[inline(always)]
    fn multiply_few<const P: usize>(
        columns: &[Row<f32>],
        start: &[Row<f32>],
        input: [&[Row<f32>]; P],
        output: &mut [Row<f32>],
    ) {
        portable::multiply_few::<f32, Self, P>(columns, start, input, output);
    }
    /// The sum of outer products of [`crate::outer`].
    #[inline(always)]
    fn outer(sides: &[(&[Row<f32>], &[f32])], rows: usize, columns: usize, gradient: &mut [f32]) {
        portable::outer::<f32, Self>(sides, rows, columns, gradient);
    }
    /// The transposition of [`Lane::transpose`](crate::Lane::transpose).
    #[inline(always)]
    fn transpose(rows: &[Row<f32>], out: &mut [f32]) {
        portable::transpose(rows, out);
    }
}

/// A computation over a batch, generic over the instruction set.
///
/// Implementations mark `run` with `#[inline(always)]`: all of it is then compiled for the
/// instruction set.
pub trait Pass {
    /// Runs the computation with the instructions of `I`.
    fn run<I: Isa>(self);
}

/// a b + c, rounded once where the instruction set has a fused multiply–add.
#[inline(always)]
pub fn fma<R: Real, I: Isa>(a: R, b: R, c: R) -> R {
    if I::FMA { a.mul_add(b, c) } else { a * b + c }
}
