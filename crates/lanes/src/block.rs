//! Blocks of points as rows of lanes, and weights packed for them.

use field::Real;

use super::group::Group;

/// Points of a block, side by side in a row: two AVX-512 registers of 16 numbers.
pub const LANES: usize = 32;

/// Points of half a block. A block with at most this many points takes half the time, and less
/// where it takes the sweeps for a few points; a parameter VJP always computes whole blocks.
///
/// Sweeps have the number of lanes to compute as a parameter `N`: `LANES`, `HALF` or
/// [`GROUP`](crate::GROUP).
pub const HALF: usize = LANES / 2;

/// Points that take less time with [`multiply_few`](crate::multiply_few) than as half a block. At
/// 8 points, both products take about as many multiply–adds of registers as half of that.
pub const FEW_POINTS: usize = 8;

/// Rows of a matrix that are packed together.
pub const TILE: usize = 8;

/// One feature of all points of a block, or some features of one of a few points.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct Row<R>(pub [R; LANES]);

impl<R: Real> Row<R> {
    /// A row of zeros.
    pub fn zero() -> Self {
        Row([R::zero(); LANES])
    }

    /// The numbers of group `g`.
    #[inline(always)]
    pub fn group<V: Group<R>>(&self, g: usize) -> V {
        V::load(&self.0.as_chunks().0[g])
    }

    /// Sets the numbers of group `g`.
    #[inline(always)]
    pub fn set_group<V: Group<R>>(&mut self, g: usize, values: V) {
        values.store(&mut self.0.as_chunks_mut().0[g]);
    }
}

/// The rows for the results of [`Lane::softplus`](crate::Lane::softplus): value, slope and
/// curvature.
pub type Softplus<'a, R> = [&'a mut Row<R>; 3];

/// Packs a matrix for [`multiply`](crate::multiply): tile by tile of `TILE` rows, column
/// by column in a tile. Rows after the last are zero.
pub fn pack<R: Real>(
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

/// Packs a matrix for [`multiply_few`](crate::multiply_few): for every group of `LANES` rows, its
/// columns. Rows after the last are zero.
pub fn pack_columns<R: Real>(
    rows: usize,
    columns: usize,
    entry: impl Fn(usize, usize) -> R,
    out: &mut Vec<Row<R>>,
) {
    out.clear();
    for group in 0..rows.div_ceil(LANES) {
        for column in 0..columns {
            out.push(Row(std::array::from_fn(|r| {
                let row = group * LANES + r;
                if row < rows { entry(row, column) } else { R::zero() }
            })));
        }
    }
}

/// The length of a weight gradient's rows is a multiple of this: AVX-512 kernels load and store
/// registers of 16 numbers.
const COLUMN_MULTIPLE: usize = 16;

/// The padded length of a row of a weight gradient with `columns` columns.
pub fn padded(columns: usize) -> usize {
    columns.div_ceil(COLUMN_MULTIPLE) * COLUMN_MULTIPLE
}
