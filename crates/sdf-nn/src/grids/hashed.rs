//! A multi-resolution hash grid: trainable features on grids of several resolutions.
//!
//! Müller, Evans, Schied and Keller, "Instant Neural Graphics Primitives with a Multiresolution
//! Hash Encoding", SIGGRAPH 2022, section 3: trainable features at the corners of grids of several
//! resolutions, interpolated linearly. A level with more corners than entries shares entries by a
//! hash of the corner's indices (their equation 4); a surface meets few of the corners.

use std::ops::Range;

use field::{Real, TableSum};

/// Features of an entry.
pub const FEATURES: usize = 2;

/// The largest number of entries of a level: a power of two.
const MOST_ENTRIES: usize = 1 << 16;

/// The most cells along a side of a level.
pub const MOST_CELLS: usize = 4096;

/// The most levels.
pub const MOST_LEVELS: usize = 8;

/// Corners of a cell.
const CORNERS: usize = 8;

/// A grid over the cube [−1, 1]³ around the unit ball.
#[derive(Clone, Copy, Debug)]
struct Level {
    /// Cells along a side.
    cells: usize,
    /// The number of the first feature in the tables.
    start: usize,
}

/// The number of entries of a level with this many cells along a side.
fn entries(cells: usize) -> usize {
    (cells + 1).pow(3).min(MOST_ENTRIES)
}

/// A corner's place in the tables, and the factors of its weight along the axes, whose product is
/// the weight.
struct Corner<R> {
    at: usize,
    factors: [R; 3],
    /// The derivatives of the factors by the place in the cell: 1 or −1; 0 beside the cube.
    signs: [R; 3],
}

impl Level {
    /// The corners of the cell of a point of the cube.
    #[inline(always)]
    fn corners<R: Real>(&self, y: [R; 3]) -> [Corner<R>; CORNERS] {
        let place = y.map(|c| (c + R::one()) * self.scale());
        let base = place.map(|p| p.max(R::zero()).to_usize().unwrap_or(0).min(self.cells - 1));
        let part: [R; 3] = std::array::from_fn(|a| {
            (place[a] - R::of(base[a] as f64)).max(R::zero()).min(R::one())
        });
        let most = R::of(self.cells as f64);
        let is_inside = place.map(|p| p >= R::zero() && p <= most);
        std::array::from_fn(|corner| {
            let upper: [bool; 3] = std::array::from_fn(|a| corner >> a & 1 == 1);
            let index = std::array::from_fn(|a| base[a] + usize::from(upper[a]));
            Corner {
                at: self.start + FEATURES * self.entry(index),
                factors: std::array::from_fn(
                    |a| if upper[a] { part[a] } else { R::one() - part[a] },
                ),
                signs: std::array::from_fn(|a| match (is_inside[a], upper[a]) {
                    (false, _) => R::zero(),
                    (true, true) => R::one(),
                    (true, false) => -R::one(),
                }),
            }
        })
    }

    /// Cells per unit of length.
    fn scale<R: Real>(&self) -> R {
        R::of(0.5 * self.cells as f64)
    }

    /// The entry of a corner, by its indices along the axes.
    #[inline(always)]
    fn entry(&self, [x, y, z]: [usize; 3]) -> usize {
        let side = self.cells + 1;
        if entries(self.cells) < MOST_ENTRIES {
            return (z * side + y) * side + x;
        }
        let hash = (x as u32)
            ^ (y as u32).wrapping_mul(2_654_435_761)
            ^ (z as u32).wrapping_mul(805_459_861);
        hash as usize % MOST_ENTRIES
    }
}

/// A multi-resolution hash grid: [`FEATURES`] features for each level.
#[derive(Clone, Debug, Default)]
pub struct HashGrid {
    levels: Vec<Level>,
}

impl HashGrid {
    /// A grid with levels of these numbers of cells along a side.
    ///
    /// # Panics
    /// If a number is not from 1 to [`MOST_CELLS`].
    pub fn new(cells: &[usize]) -> Self {
        assert!(cells.iter().all(|c| (1..=MOST_CELLS).contains(c)), "cells of grids: {cells:?}");
        let starts = cells.iter().scan(0, |next, cells| {
            let start = *next;
            *next += FEATURES * entries(*cells);
            Some(start)
        });
        let level = |(cells, start): (&usize, usize)| Level { cells: *cells, start };
        HashGrid { levels: cells.iter().zip(starts).map(level).collect() }
    }

    /// The numbers of cells along a side.
    pub fn cells(&self) -> impl ExactSizeIterator<Item = usize> + '_ {
        self.levels.iter().map(|level| level.cells)
    }

    /// The number of features of a point.
    pub fn features(&self) -> usize {
        FEATURES * self.levels.len()
    }

    /// The place of each level in the tables: [`FEATURES`] numbers for each of its entries.
    pub fn ranges(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        self.levels.iter().map(|l| l.start..l.start + FEATURES * entries(l.cells))
    }

    /// The number of numbers in the tables of all levels.
    pub fn table_length(&self) -> usize {
        self.ranges().last().map_or(0, |range| range.end)
    }

    /// Passes the number and the value of each feature of a point of the unit ball to `put`.
    #[inline(always)]
    pub fn encode<R: Real>(&self, tables: &[R], y: [R; 3], mut put: impl FnMut(usize, R)) {
        for (l, level) in self.levels.iter().enumerate() {
            let mut sums = [R::zero(); FEATURES];
            for Corner { at, factors: [a, b, c], .. } in level.corners(y) {
                let weight = a * b * c;
                let entry = sums.iter_mut().zip(&tables[at..at + FEATURES]);
                entry.for_each(|(sum, feature)| *sum += weight * *feature);
            }
            sums.into_iter().enumerate().for_each(|(f, sum)| put(FEATURES * l + f, sum));
        }
    }

    /// VJP of (y, tables) ↦ features: adds the adjoint of the tables to `sums`, and returns that of
    /// the point. `adjoint` gives the adjoint of each feature.
    #[inline(always)]
    pub fn encode_vjp<R: Real>(
        &self,
        tables: &[R],
        y: [R; 3],
        adjoint: impl Fn(usize) -> R,
        sums: &mut TableSum<'_, R>,
    ) -> [R; 3] {
        let mut out = [R::zero(); 3];
        for (l, level) in self.levels.iter().enumerate() {
            let bars: [R; FEATURES] = std::array::from_fn(|f| adjoint(FEATURES * l + f));
            for Corner { at, factors, signs } in level.corners(y) {
                let weight = factors[0] * factors[1] * factors[2];
                let mut along = R::zero();
                sums.add_pair(at, bars.map(|bar| weight * bar));
                for (bar, feature) in bars.iter().zip(&tables[at..at + FEATURES]) {
                    along += *bar * *feature;
                }
                for (a, out) in out.iter_mut().enumerate() {
                    let others = factors[(a + 1) % 3] * factors[(a + 2) % 3];
                    *out += along * signs[a] * others * level.scale();
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    /// The last level has more corners than entries.
    const CELLS: [usize; 3] = [2, 5, 50];

    fn tables(grid: &HashGrid) -> Vec<f64> {
        (0..grid.table_length()).map(|i| (0.7 * i as f64).sin()).collect()
    }

    /// The sum of all features times 1, 2, 3, ….
    fn total(grid: &HashGrid, tables: &[f64], y: [f64; 3]) -> f64 {
        let mut sum = 0.0;
        grid.encode(tables, y, |i, value| sum += (i + 1) as f64 * value);
        sum
    }

    #[test]
    fn the_reverse_mode_matches_differences() {
        let grid = HashGrid::new(&CELLS);
        let tables = tables(&grid);
        let y = [0.31, -0.47, 0.83];
        let mut sums = vec![0.0; tables.len()];
        let bars =
            grid.encode_vjp(&tables, y, |i| (i + 1) as f64, &mut TableSum::Vector(&mut sums));
        let h = 1e-6;
        for axis in 0..3 {
            let moved = |h: f64| {
                let mut y = y;
                y[axis] += h;
                total(&grid, &tables, y)
            };
            let difference = (moved(h) - moved(-h)) / (2.0 * h);
            assert_relative_eq!(bars[axis], difference, max_relative = 1e-6);
        }
        let met: Vec<usize> = (0..sums.len()).filter(|i| sums[*i] != 0.0).collect();
        assert_eq!(met.len(), FEATURES * CORNERS * CELLS.len());
        for i in met {
            let mut moved = tables.clone();
            moved[i] += 1.0;
            let difference = total(&grid, &moved, y) - total(&grid, &tables, y);
            assert_relative_eq!(sums[i], difference, max_relative = 1e-9);
        }
    }

    #[test]
    fn points_outside_have_the_features_of_the_nearest_point_of_the_cube() {
        let grid = HashGrid::new(&CELLS);
        let tables = tables(&grid);
        let far = [7.0, -9.0, 0.3];
        assert_eq!(total(&grid, &tables, far), total(&grid, &tables, [1.0, -1.0, 0.3]));
        let bars = grid.encode_vjp(
            &tables,
            far,
            |_| 1.0,
            &mut TableSum::Vector(&mut vec![0.0; tables.len()]),
        );
        assert!(bars[0] == 0.0 && bars[1] == 0.0 && bars[2] != 0.0, "{bars:?}");
    }
}
