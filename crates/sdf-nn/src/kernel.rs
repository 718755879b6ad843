//! The inner loops: blocks of points as rows of lanes, multiplied by packed weights.
//!
//! Everything here is `#[inline(always)]` so that it is compiled once for each instruction set by
//! [`crate::simd`], which has the same loops in vectors for single precision. The order of sums is
//! the same in all of them.

use field::Real;

use crate::simd::Isa;

/// Points processed side by side: two registers of 16 numbers.
pub(crate) const LANES: usize = 32;

/// What fewer points are processed as, at half the cost. Sweeps have the number of lanes that they
/// go through as a parameter `N`.
pub(crate) const HALF: usize = LANES / 2;

/// Rows of output packed together.
pub(crate) const TILE: usize = 8;

/// Rows and lanes whose sums the portable loops keep in registers.
const PART: [usize; 2] = [4, 8];

/// One feature of all points of a block.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct Row<R>(pub(crate) [R; LANES]);

impl<R: Real> Row<R> {
    /// A row of zeros.
    pub(crate) fn zero() -> Self {
        Row([R::zero(); LANES])
    }
}

/// a b + c.
#[inline(always)]
pub(crate) fn fma<R: Real, I: Isa>(a: R, b: R, c: R) -> R {
    if I::FMA { a.mul_add(b, c) } else { a * b + c }
}

/// The first `rows` rows of output = W input + start, for `W` packed by [`pack`]; `output` has
/// whole tiles of rows.
#[inline(always)]
pub(crate) fn multiply_rows<R: Real, I: Isa, const N: usize>(
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

/// Packs a matrix given by its entries for [`multiply_rows`]: tile by tile of rows, column by
/// column.
pub(crate) fn pack<R: Real>(
    rows: usize,
    columns: usize,
    entry: impl Fn(usize, usize) -> R,
    out: &mut Vec<[R; TILE]>,
) {
    out.clear();
    for tile in 0..rows.div_ceil(TILE) {
        for column in 0..columns {
            out.push(std::array::from_fn(|r| {
                let row = tile * TILE + r;
                if row < rows { entry(row, column) } else { R::zero() }
            }));
        }
    }
}

/// Columns of a weight gradient come in multiples of this.
const WIDE: usize = 16;

/// The length of a row of a weight gradient with `columns` columns.
pub(crate) fn padded(columns: usize) -> usize {
    columns.div_ceil(WIDE) * WIDE
}

/// Transposes rows of lanes: `out[lane * padded + row]`, the rest zero.
#[inline(always)]
pub(crate) fn transpose_lanes<R: Real>(rows: &[Row<R>], out: &mut [R]) {
    let stride = padded(rows.len());
    for (r, row) in rows.iter().enumerate() {
        for l in 0..LANES {
            out[l * stride + r] = row.0[l];
        }
    }
}

/// The first `rows` rows of gradient += Σ_sides Σ_lanes adjoint inputᵀ: rows of `padded(columns)`;
/// every side is an adjoint and an input, transposed.
#[inline(always)]
pub(crate) fn outer_rows<R: Real, I: Isa>(
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
