//! The inner loops: blocks of points as rows of lanes, multiplied by packed weights.
//!
//! Everything here is `#[inline(always)]` so that it is compiled once for each instruction set by [`crate::dispatch`]. `FMA` says
//! whether a fused multiply–add is an instruction there; where it is not, it would be a slow library call.

use field::Real;

/// Points processed side by side: two 8-lane registers of single precision.
pub(crate) const LANES: usize = 16;

/// Rows of output computed together: with two registers a row, eight independent chains of fused multiply–adds, which is
/// what hides their latency (4 cycles, 2 a cycle) on current x86 cores.
pub(crate) const TILE: usize = 4;

/// One feature of all points of a block.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Row<R>(pub(crate) [R; LANES]);

impl<R: Real> Row<R> {
    /// A row of zeros.
    pub(crate) fn zero() -> Self {
        Row([R::zero(); LANES])
    }
}

/// a b + c.
#[inline(always)]
pub(crate) fn fma<R: Real, const FMA: bool>(a: R, b: R, c: R) -> R {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// output = W input + start, for `W` packed by [`pack`]; `output` has whole tiles of rows.
#[inline(always)]
pub(crate) fn multiply<R: Real, const FMA: bool>(
    packed: &[[R; TILE]],
    start: &[R],
    input: &[Row<R>],
    output: &mut [Row<R>],
) {
    let n = input.len();
    for (tile, out) in output.chunks_exact_mut(TILE).enumerate() {
        let mut sums = [[R::zero(); LANES]; TILE];
        for (r, sum) in sums.iter_mut().enumerate() {
            if let Some(s) = start.get(tile * TILE + r) {
                *sum = [*s; LANES];
            }
        }
        for (w, x) in packed[tile * n..(tile + 1) * n].iter().zip(input) {
            for r in 0..TILE {
                for l in 0..LANES {
                    sums[r][l] = fma::<R, FMA>(w[r], x.0[l], sums[r][l]);
                }
            }
        }
        for (out, sum) in out.iter_mut().zip(sums) {
            out.0 = sum;
        }
    }
}

/// Packs a matrix given by its entries for [`multiply`]: tile by tile of rows, column by column.
pub(crate) fn pack<R: Real>(rows: usize, columns: usize, entry: impl Fn(usize, usize) -> R, out: &mut Vec<[R; TILE]>) {
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

/// Columns of a weight gradient updated together.
const WIDE: usize = 16;

/// The length of a row of a weight gradient with `columns` columns.
pub(crate) fn padded(columns: usize) -> usize {
    columns.div_ceil(WIDE) * WIDE
}

/// Transposes rows of lanes: `out[lane * padded + row]`, the rest zero.
#[inline(always)]
pub(crate) fn transpose<R: Real>(rows: &[Row<R>], out: &mut [R]) {
    let stride = padded(rows.len());
    for (r, row) in rows.iter().enumerate() {
        for l in 0..LANES {
            out[l * stride + r] = row.0[l];
        }
    }
}

/// gradient += Σ_lanes adjoint inputᵀ: rows of `padded(columns)`; `input` is transposed.
#[inline(always)]
pub(crate) fn outer<R: Real, const FMA: bool>(adjoint: &[Row<R>], input: &[R], columns: usize, gradient: &mut [R]) {
    let stride = padded(columns);
    for (rows, out) in adjoint.chunks_exact(TILE).zip(gradient.chunks_exact_mut(TILE * stride)) {
        for start in (0..stride).step_by(WIDE) {
            let mut sums = [[R::zero(); WIDE]; TILE];
            for l in 0..LANES {
                let x: &[R; WIDE] = match input[l * stride + start..].first_chunk() {
                    Some(x) => x,
                    None => return,
                };
                for r in 0..TILE {
                    let a = rows[r].0[l];
                    for c in 0..WIDE {
                        sums[r][c] = fma::<R, FMA>(a, x[c], sums[r][c]);
                    }
                }
            }
            for r in 0..TILE {
                for c in 0..WIDE {
                    out[r * stride + start + c] += sums[r][c];
                }
            }
        }
    }
}
