//! Instruction sets, and computations that are compiled for each.

use field::Real;

use super::block::{Row, Softplus, TILE};
use super::group::Group;
use super::table::{Sums, TableRows};

/// An instruction set that kernels are compiled for, with its kernels in single precision.
pub trait Isa: Copy {
    /// Whether a fused multiply–add is one instruction. Elsewhere it would be a slow library call.
    const FMA: bool;

    /// Numbers of a group of points.
    type Group: Group<f32>;

    /// Runs a part of a pass with these instructions, as a function of its own. All passes that
    /// have the part share its code; a call takes a few nanoseconds.
    fn call<P: Pass>(part: P);

    /// The matrix product of [`crate::multiply`].
    fn multiply<const N: usize>(
        packed: &[[f32; TILE]],
        start: &[f32],
        rows: usize,
        input: &[Row<f32>],
        output: &mut [Row<f32>],
    );

    /// The matrix product of [`crate::multiply_few`].
    fn multiply_few<const P: usize>(
        columns: &[Row<f32>],
        start: &[Row<f32>],
        input: [&[Row<f32>]; P],
        output: &mut [Row<f32>],
    );

    /// The sum of outer products of [`crate::outer`].
    fn outer(sides: &[(&[Row<f32>], &[f32])], rows: usize, columns: usize, gradient: &mut [f32]);

    /// The transposition of [`Lane::transpose`](crate::Lane::transpose).
    fn transpose(rows: &[Row<f32>], out: &mut [f32]);

    /// The rows of [`Lane::softplus`](crate::Lane::softplus).
    fn softplus<const N: usize, const STORE: bool, const TANGENT: bool>(
        beta: f64,
        z: &Row<f32>,
        out: Softplus<'_, f32>,
    );

    /// The sums of [`Lane::sum_rows`](crate::Lane::sum_rows).
    fn sum_rows<const T: usize, const ORDER: usize>(
        rows: &TableRows<'_, f32, T>,
        sums: &mut Sums<f32>,
    );
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
