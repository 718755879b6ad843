//! The kernels as functions of their own: the code of a pass that calls one has no copy of it.

use crate::{Isa, Lane, Pass, Row, TILE};

struct Multiply<'a, R, const N: usize> {
    packed: &'a [[R; TILE]],
    start: &'a [R],
    rows: usize,
    input: &'a [Row<R>],
    output: &'a mut [Row<R>],
}

impl<R: Lane, const N: usize> Pass for Multiply<'_, R, N> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        R::multiply::<I, N>(self.packed, self.start, self.rows, self.input, self.output);
    }
}

struct MultiplyFew<'a, R, const P: usize> {
    columns: &'a [Row<R>],
    start: &'a [Row<R>],
    input: [&'a [Row<R>]; P],
    output: &'a mut [Row<R>],
}

impl<R: Lane, const P: usize> Pass for MultiplyFew<'_, R, P> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        R::multiply_few::<I, P>(self.columns, self.start, self.input, self.output);
    }
}

struct Outer<'a, R> {
    sides: &'a [(&'a [Row<R>], &'a [R])],
    rows: usize,
    columns: usize,
    gradient: &'a mut [R],
}

impl<R: Lane> Pass for Outer<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        R::outer::<I>(self.sides, self.rows, self.columns, self.gradient);
    }
}

/// Writes the first `rows` rows of W `input` + `start`, for the first `N` lanes.
///
/// `packed` is the matrix W from [`pack`](crate::pack). Rows after the end of `start` start at
/// zero. `output` has whole tiles of rows.
#[inline(always)]
pub fn multiply<R: Lane, I: Isa, const N: usize>(
    packed: &[[R; TILE]],
    start: &[R],
    rows: usize,
    input: &[Row<R>],
    output: &mut [Row<R>],
) {
    I::call(Multiply::<R, N> { packed, start, rows, input, output });
}

/// Writes W x + `start` for each of `P` points x: lanes are rows of the matrix here, so no lane is
/// left empty where points are few.
///
/// `columns` is the matrix from [`pack_columns`](crate::pack_columns), and `start` has a row for
/// each of its groups. The numbers of a point of `input` lie side by side in rows. `output` has,
/// for each group, the rows of the points. The sums have the order of [`multiply`], and so its
/// bits.
#[inline(always)]
pub fn multiply_few<R: Lane, I: Isa, const P: usize>(
    columns: &[Row<R>],
    start: &[Row<R>],
    input: [&[Row<R>]; P],
    output: &mut [Row<R>],
) {
    I::call(MultiplyFew::<R, P> { columns, start, input, output });
}

/// Adds `Σ_sides Σ_lanes adjoint inputᵀ` to the first `rows` rows of `gradient`.
///
/// A side is the adjoint of a layer's z and the layer's input, transposed by [`Lane::transpose`].
/// Rows of `gradient` have length `padded(columns)`.
#[inline(always)]
pub fn outer<R: Lane, I: Isa>(
    sides: &[(&[Row<R>], &[R])],
    rows: usize,
    columns: usize,
    gradient: &mut [R],
) {
    I::call(Outer { sides, rows, columns, gradient });
}
