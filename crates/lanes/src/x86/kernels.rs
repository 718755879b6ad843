//! The kernels of [`portable`](crate::portable) with explicit vectors, in the same order of
//! sums.
//!
//! Loops in place of `from_fn`: a closure is not always inlined, and is then not compiled for the
//! vector instructions.

use super::vector::Vector;
use crate::block::{LANES, Row, TILE, padded};
use crate::group::GROUP;
use crate::table::{ORDERS, Sums, TableRows, derivatives};

/// [`multiply`](crate::multiply) with `ROWS` × `REGS` sums in registers.
#[inline(always)]
pub(super) fn multiply<V: Vector, const N: usize, const ROWS: usize, const REGS: usize>(
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
        // One row alone (a network's output) takes registers for one row.
        if rows - tile * TILE == 1 {
            multiply_tile_rows::<V, N, 1, REGS>(weights, start, 0, input, out);
            continue;
        }
        for first in (0..TILE).step_by(ROWS) {
            multiply_tile_rows::<V, N, ROWS, REGS>(weights, start, first, input, out);
        }
    }
}

/// [`multiply`] for `ROWS` rows of a tile, from row `first`.
#[inline(always)]
fn multiply_tile_rows<V: Vector, const N: usize, const ROWS: usize, const REGS: usize>(
    weights: &[[f32; TILE]],
    start: &[f32],
    first: usize,
    input: &[Row<f32>],
    out: &mut [Row<f32>],
) {
    for lane in (0..N).step_by(REGS * V::N) {
        let mut sums = [[V::splat(0.0); REGS]; ROWS];
        // Constant indices only: otherwise the loop also stores the sums in memory.
        for r in 0..ROWS {
            sums[r] = [V::splat(start.get(first + r).copied().unwrap_or(0.0)); REGS];
        }
        for (w, row) in weights.iter().zip(input) {
            let mut x = [V::splat(0.0); REGS];
            for v in 0..REGS {
                x[v] = V::load(&row.0[lane + v * V::N..]);
            }
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

/// [`multiply_few`](crate::multiply_few) with `REGS` registers of a row.
#[inline(always)]
pub(super) fn multiply_few<V: Vector, const P: usize, const REGS: usize>(
    columns: &[Row<f32>],
    start: &[Row<f32>],
    input: [&[Row<f32>]; P],
    output: &mut [Row<f32>],
) {
    let inputs = columns.len() / start.len();
    let mut group = 0;
    while group < start.len() {
        // One or two points alone have too few sums to hide the latency of a multiply–add.
        let groups = if P <= 2 && group + 2 <= start.len() { 2 } else { 1 };
        let columns = &columns[group * inputs..(group + groups) * inputs];
        let (start, output) = (&start[group..group + groups], &mut output[group * P..]);
        if groups == 2 {
            multiply_groups::<V, P, REGS, 2>(columns, start, input, output);
        } else {
            multiply_groups::<V, P, REGS, 1>(columns, start, input, output);
        }
        group += groups;
    }
}

/// [`multiply_few`] for `G` groups of rows, with `P` × `G` × `REGS` sums in registers.
#[inline(always)]
fn multiply_groups<V: Vector, const P: usize, const REGS: usize, const G: usize>(
    columns: &[Row<f32>],
    start: &[Row<f32>],
    input: [&[Row<f32>]; P],
    output: &mut [Row<f32>],
) {
    let inputs = columns.len() / G;
    for lane in (0..LANES).step_by(REGS * V::N) {
        let mut sums = [[[V::splat(0.0); REGS]; G]; P];
        for p in 0..P {
            for g in 0..G {
                for v in 0..REGS {
                    sums[p][g][v] = V::load(&start[g].0[lane + v * V::N..]);
                }
            }
        }
        for first in (0..inputs).step_by(LANES) {
            for c in 0..LANES.min(inputs - first) {
                let mut w = [[V::splat(0.0); REGS]; G];
                for g in 0..G {
                    for v in 0..REGS {
                        let column = &columns[g * inputs + first + c];
                        w[g][v] = V::load(&column.0[lane + v * V::N..]);
                    }
                }
                for p in 0..P {
                    let x = V::splat(input[p][first / LANES].0[c]);
                    for g in 0..G {
                        for v in 0..REGS {
                            sums[p][g][v] = V::fma(w[g][v], x, sums[p][g][v]);
                        }
                    }
                }
            }
        }
        for p in 0..P {
            for g in 0..G {
                for v in 0..REGS {
                    sums[p][g][v].store(&mut output[g * P + p].0[lane + v * V::N..]);
                }
            }
        }
    }
}

/// [`outer`](crate::outer) with `ROWS` × `REGS` sums in registers.
#[inline(always)]
pub(super) fn outer<V: Vector, const ROWS: usize, const REGS: usize>(
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
                (1, true) => outer_part::<V, 1, REGS>(sides, first, column, stride, out),
                (1, false) => outer_part::<V, 1, 1>(sides, first, column, stride, out),
                (_, true) => outer_part::<V, ROWS, REGS>(sides, first, column, stride, out),
                (_, false) => outer_part::<V, ROWS, 1>(sides, first, column, stride, out),
            }
            column += if wide { REGS * V::N } else { V::N };
        }
    }
}

/// [`outer`] for `ROWS` rows from row `first`, and `REGS` registers of columns from `column`.
#[inline(always)]
fn outer_part<V: Vector, const ROWS: usize, const REGS: usize>(
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
            let mut x = [V::splat(0.0); REGS];
            for v in 0..REGS {
                x[v] = V::load(&input[column + v * V::N..]);
            }
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

/// [`Lane::transpose`](crate::Lane::transpose) in squares of `N` = `V::N` rows and lanes.
#[inline(always)]
pub(super) fn transpose<V: Vector, const N: usize>(rows: &[Row<f32>], out: &mut [f32]) {
    let stride = padded(rows.len());
    for first in (0..rows.len()).step_by(N) {
        for lane in (0..LANES).step_by(N) {
            let mut square = [V::splat(0.0); N];
            for (square, row) in square.iter_mut().zip(&rows[first..]) {
                *square = V::load(&row.0[lane..]);
            }
            V::transpose(&mut square);
            for (l, column) in square.into_iter().enumerate() {
                column.store(&mut out[(lane + l) * stride + first..]);
            }
        }
    }
}

/// The bits of all points of a group.
const ALL: u32 = (1 << GROUP) - 1;

/// [`Lane::sum_rows`](crate::Lane::sum_rows) with a register, of [`GROUP`] numbers, for a row.
#[inline(always)]
pub(super) fn sum_rows<V: Vector, const T: usize, const ORDER: usize>(
    rows: &TableRows<'_, f32, T>,
    sums: &mut Sums<f32>,
) {
    let sums = &mut sums[..derivatives(ORDER)];
    if rows.met != ALL {
        sums.as_flattened_mut().as_flattened_mut().fill(0.0);
    }
    let mut met = rows.met & ALL;
    while met != 0 {
        let point = met.trailing_zeros() as usize;
        met &= met - 1;
        let total = sum_of_point::<V, T, ORDER>(rows, point);
        for kind in 0..derivatives(ORDER) {
            total[kind].store(&mut sums[kind][point]);
        }
    }
    for square in sums {
        let mut registers = [V::splat(0.0); GROUP];
        for k in 0..GROUP {
            registers[k] = V::load(&square[k]);
        }
        V::transpose(&mut registers);
        for k in 0..GROUP {
            registers[k].store(&mut square[k]);
        }
    }
}

/// The sums of the rows of a point, by derivative.
#[inline(always)]
fn sum_of_point<V: Vector, const T: usize, const ORDER: usize>(
    rows: &TableRows<'_, f32, T>,
    point: usize,
) -> [V; 6] {
    let [x, y] = rows.weights;
    let table = rows.of_point(point);
    let mut total = [V::splat(0.0); 6];
    for i in 0..T {
        let mut along = [V::splat(0.0); 3];
        for j in 0..T {
            let at = i * rows.steps[0] + j * rows.steps[1];
            // SAFETY: `of_point` gives all rows of the point.
            let row = V::load(unsafe { table.get_unchecked(at..at + GROUP) });
            for order in 0..=ORDER {
                along[order] = V::fma(V::splat(y[order][j][point]), row, along[order]);
            }
        }
        for kind in 0..derivatives(ORDER) {
            let [of_x, of_y] = ORDERS[kind];
            total[kind] = V::fma(V::splat(x[of_x][i][point]), along[of_y], total[kind]);
        }
    }
    total
}
