//! Kernels for every machine and both precisions, without explicit vectors.

use field::Real;

use super::block::{LANES, Row, Softplus, TILE, padded};
use super::group::GROUP;
use super::isa::{Isa, Pass, fma};
use super::plain::Plain;
use super::single::{exp_negative, ln_one_plus};
use super::table::{ORDERS, Sums, TableRows, derivatives};

/// Instructions that every machine has.
#[derive(Clone, Copy, Debug)]
pub struct Portable;

impl Isa for Portable {
    const FMA: bool = cfg!(target_arch = "aarch64");

    type Group = Plain<f32, Self>;

    #[inline(never)]
    fn call<P: Pass>(part: P) {
        part.run::<Self>();
    }

    #[inline(always)]
    fn multiply<const N: usize>(
        packed: &[[f32; TILE]],
        start: &[f32],
        rows: usize,
        input: &[Row<f32>],
        output: &mut [Row<f32>],
    ) {
        multiply::<f32, Self, N>(packed, start, rows, input, output);
    }
    #[inline(always)]
    fn multiply_few<const P: usize>(
        columns: &[Row<f32>],
        start: &[Row<f32>],
        input: [&[Row<f32>]; P],
        output: &mut [Row<f32>],
    ) {
        multiply_few::<f32, Self, P>(columns, start, input, output);
    }
    #[inline(always)]
    fn outer(sides: &[(&[Row<f32>], &[f32])], rows: usize, columns: usize, gradient: &mut [f32]) {
        outer::<f32, Self>(sides, rows, columns, gradient);
    }
    #[inline(always)]
    fn transpose(rows: &[Row<f32>], out: &mut [f32]) {
        transpose(rows, out);
    }
    #[inline(always)]
    fn softplus<const N: usize, const STORE: bool, const TANGENT: bool>(
        beta: f64,
        z: &Row<f32>,
        mut out: Softplus<'_, f32>,
    ) {
        for l in 0..N {
            let e = exp_negative::<Self>(beta as f32 * z.0[l].abs());
            let terms = [e, ln_one_plus::<Self>(e)];
            softplus_lane::<f32, Self, STORE, TANGENT>(beta, z.0[l], terms, &mut out, l);
        }
    }
    #[inline(always)]
    fn sum_rows<const T: usize, const ORDER: usize>(
        rows: &TableRows<'_, f32, T>,
        sums: &mut Sums<f32>,
    ) {
        sum_rows::<f32, Self, T, ORDER>(rows, sums);
    }
}

/// Rows and lanes (or columns) whose sums stay in registers.
const PART: [usize; 2] = [4, 8];

/// [`multiply`](crate::multiply) without explicit vectors.
#[inline(always)]
pub(super) fn multiply<R: Real, I: Isa, const N: usize>(
    packed: &[[R; TILE]],
    start: &[R],
    rows: usize,
    input: &[Row<R>],
    output: &mut [Row<R>],
) {
    let n = input.len();
    for (tile, out) in output.chunks_exact_mut(TILE).enumerate().take(rows.div_ceil(TILE)) {
        let weights = &packed[tile * n..(tile + 1) * n];
        for first in (0..TILE).step_by(PART[0]).take_while(|first| tile * TILE + first < rows) {
            for lane in (0..N).step_by(PART[1]) {
                let mut sums = [[R::zero(); PART[1]]; PART[0]];
                for (r, sum) in sums.iter_mut().enumerate() {
                    if let Some(s) = start.get(tile * TILE + first + r) {
                        *sum = [*s; PART[1]];
                    }
                }
                for (w, x) in weights.iter().zip(input) {
                    for r in 0..PART[0] {
                        for l in 0..PART[1] {
                            sums[r][l] = fma::<R, I>(w[first + r], x.0[lane + l], sums[r][l]);
                        }
                    }
                }
                for (r, sum) in sums.iter().enumerate() {
                    out[first + r].0[lane..lane + PART[1]].copy_from_slice(sum);
                }
            }
        }
    }
}

/// [`multiply_few`](crate::multiply_few) without explicit vectors.
#[inline(always)]
pub(super) fn multiply_few<R: Real, I: Isa, const P: usize>(
    columns: &[Row<R>],
    start: &[Row<R>],
    input: [&[Row<R>]; P],
    output: &mut [Row<R>],
) {
    let inputs = columns.len() / start.len();
    for (group, start) in start.iter().enumerate() {
        let columns = &columns[group * inputs..(group + 1) * inputs];
        for p in 0..P {
            let mut sum = *start;
            for (c, column) in columns.iter().enumerate() {
                let x = input[p][c / LANES].0[c % LANES];
                for l in 0..LANES {
                    sum.0[l] = fma::<R, I>(column.0[l], x, sum.0[l]);
                }
            }
            output[group * P + p] = sum;
        }
    }
}

/// [`Lane::transpose`](crate::Lane::transpose) without explicit vectors.
#[inline(always)]
pub(super) fn transpose<R: Real>(rows: &[Row<R>], out: &mut [R]) {
    let stride = padded(rows.len());
    for (r, row) in rows.iter().enumerate() {
        for l in 0..LANES {
            out[l * stride + r] = row.0[l];
        }
    }
}

/// Lane `l` of [`Lane::softplus`](crate::Lane::softplus): max(0, z) + ln(1 + e)/β with
/// e = exp(−β|z|), which cannot overflow.
#[inline(always)]
pub(super) fn softplus_lane<R: Real, I: Isa, const STORE: bool, const TANGENT: bool>(
    beta: f64,
    z: R,
    [e, ln]: [R; 2],
    [value, slope, curvature]: &mut Softplus<'_, R>,
    l: usize,
) {
    // e of a NaN is a number. This is the NaN.
    let positive_part = if z < R::zero() { R::zero() } else { z };
    value.0[l] = fma::<R, I>(ln, R::of(1.0 / beta), positive_part);
    if STORE {
        let high = R::one() / (R::one() + e);
        let low = e * high;
        slope.0[l] = if z > R::zero() { high } else { low };
        if TANGENT {
            curvature.0[l] = R::of(beta) * high * low;
        }
    }
}

/// [`Lane::sum_rows`](crate::Lane::sum_rows) without explicit vectors.
#[inline(always)]
pub(super) fn sum_rows<R: Real, I: Isa, const T: usize, const ORDER: usize>(
    rows: &TableRows<'_, R, T>,
    sums: &mut Sums<R>,
) {
    let [x, y] = rows.weights;
    let sums = &mut sums[..derivatives(ORDER)];
    sums.as_flattened_mut().as_flattened_mut().fill(R::zero());
    for point in (0..GROUP).filter(|point| rows.met >> point & 1 == 1) {
        let table = rows.of_point(point);
        for i in 0..T {
            let mut along = [[R::zero(); GROUP]; 3];
            for j in 0..T {
                let row = &table[i * rows.steps[0] + j * rows.steps[1]..][..GROUP];
                for order in 0..=ORDER {
                    for k in 0..GROUP {
                        along[order][k] = fma::<R, I>(y[order][j][point], row[k], along[order][k]);
                    }
                }
            }
            for (sums, [of_x, of_y]) in sums.iter_mut().zip(ORDERS) {
                for k in 0..GROUP {
                    let sum = &mut sums[k][point];
                    *sum = fma::<R, I>(x[of_x][i][point], along[of_y][k], *sum);
                }
            }
        }
    }
}

/// [`outer`](crate::outer) without explicit vectors.
#[inline(always)]
pub(super) fn outer<R: Real, I: Isa>(
    sides: &[(&[Row<R>], &[R])],
    rows: usize,
    columns: usize,
    gradient: &mut [R],
) {
    let stride = padded(columns);
    let part = PART[0];
    for (tile, out) in
        gradient.chunks_exact_mut(part * stride).enumerate().take(rows.div_ceil(part))
    {
        for start in (0..stride).step_by(PART[1]) {
            let mut sums = [[R::zero(); PART[1]]; PART[0]];
            for (adjoint, input) in sides {
                for l in 0..LANES {
                    let Some(x) = input[l * stride + start..].first_chunk::<{ PART[1] }>() else {
                        return;
                    };
                    for r in 0..PART[0] {
                        let a = adjoint[tile * part + r].0[l];
                        for c in 0..PART[1] {
                            sums[r][c] = fma::<R, I>(a, x[c], sums[r][c]);
                        }
                    }
                }
            }
            for r in 0..PART[0] {
                for c in 0..PART[1] {
                    out[r * stride + start + c] += sums[r][c];
                }
            }
        }
    }
}
