//! Rows of a table that points add up with weights.

use super::group::GROUP;

/// The rows of a table that a group of points adds up: T × T for each point.
///
/// Row (i, j) of a point starts at its place + i `steps[0]` + j `steps[1]`, and has [`GROUP`]
/// entries.
#[derive(Clone, Copy, Debug)]
pub struct TableRows<'a, R, const T: usize> {
    /// All entries.
    pub table: &'a [R],
    /// The first entry of each point.
    pub places: &'a [usize; GROUP],
    /// Bit l is set if point l has rows.
    pub met: u32,
    /// Entries from a row to the next one: along i, along j.
    pub steps: [usize; 2],
    /// The weights by i, and those by j: by the order of the derivative, then by i or j, then by
    /// point.
    pub weights: [&'a [[[R; GROUP]; T]; 3]; 2],
}

impl<R, const T: usize> TableRows<'_, R, T> {
    /// The entries from the first to the last one of the rows of a point.
    #[inline(always)]
    pub(super) fn of_point(&self, point: usize) -> &[R] {
        let last = self.steps[0].saturating_add(self.steps[1]).saturating_mul(T - 1);
        &self.table[self.places[point]..][..last.saturating_add(GROUP)]
    }
}

/// Sums of rows: by derivative (none, x, y, xx, xy, yy), then by entry, then by point.
pub type Sums<R> = [[[R; GROUP]; GROUP]; 6];

/// The orders of the weights by i and by j for each derivative.
pub(super) const ORDERS: [[usize; 2]; 6] = [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]];

/// The number of derivatives up to an order.
pub(super) const fn derivatives(order: usize) -> usize {
    (order + 1) * (order + 2) / 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Instructions, Isa, Lane, Pass, dispatch};

    /// Sums for points 0 and 5 in single precision against double precision.
    struct Check;

    impl Pass for Check {
        fn run<I: Isa>(self) {
            let table: Vec<f32> = (0..700).map(|i| (0.37 * i as f32).sin()).collect();
            let weight = |seed: usize, order: usize, tap: usize, point: usize| {
                (1.3 * seed as f32 + 0.7 * order as f32 + 0.45 * tap as f32 + point as f32).cos()
            };
            let weights = [0, 1].map(|seed| {
                [0, 1, 2].map(|order| {
                    [0, 1, 2].map(|tap| std::array::from_fn(|l| weight(seed, order, tap, l)))
                })
            });
            let (places, steps) = ([10, 0, 0, 0, 0, 33, 0, 0], [200, 40]);
            let rows = TableRows::<f32, 3> {
                table: &table,
                places: &places,
                met: 0b10_0001,
                steps,
                weights: [&weights[0], &weights[1]],
            };
            let mut sums = [[[f32::NAN; GROUP]; GROUP]; 6];
            f32::sum_rows::<I, 3, 2>(&rows, &mut sums);
            for (kind, [of_x, of_y]) in ORDERS.into_iter().enumerate() {
                for (k, point) in (0..GROUP * GROUP).map(|n| (n / GROUP, n % GROUP)) {
                    let term = |i: usize, j: usize| {
                        let at = places[point] + i * steps[0] + j * steps[1] + k;
                        let [x, y] = [weight(0, of_x, i, point), weight(1, of_y, j, point)];
                        f64::from(x) * f64::from(y) * f64::from(table[at])
                    };
                    let all: f64 = (0..9).map(|n| term(n / 3, n % 3)).sum();
                    let expected = if matches!(point, 0 | 5) { all } else { 0.0 };
                    assert!((f64::from(sums[kind][k][point]) - expected).abs() < 1e-6);
                }
            }
        }
    }

    #[test]
    fn sums_of_rows_are_those_of_double_precision() {
        let sets = Instructions::ALL.into_iter().filter(|set| set.are_available());
        sets.for_each(|set| dispatch(set, Check));
    }
}
