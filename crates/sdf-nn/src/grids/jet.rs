//! The features of splines at a single point.

use lanes::{GROUP, Lane, Portable, Row};

use crate::grids::splines::Splines;
use crate::grids::taps::{Features, Points};

/// A feature at a point: its value, gradient, and the product of its Hessian and a vector.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Jet<R> {
    /// The value.
    pub value: R,
    /// The gradient by the point.
    pub slope: [R; 3],
    /// The Hessian times the vector.
    pub bend: [R; 3],
}

impl Splines {
    /// The features of the point `y`, with products of their Hessians and `p`.
    ///
    /// The passes of a network compute groups of points at once, and far faster.
    pub fn jets<R: Lane>(&self, table: &[R], y: [R; 3], p: [R; 3]) -> Vec<Jet<R>> {
        let count = self.size().feature_count();
        let points = Points { y: y.map(|y| [y; GROUP]), p: p.map(|p| [p; GROUP]), count: 1 };
        let mut value = vec![Row::zero(); count];
        let mut derivatives = [0, 1].map(|_| vec![[Row::zero(); 3]; count]);
        let [slope, bend] = &mut derivatives;
        let sums = [[[R::zero(); GROUP]; GROUP]; 6];
        let mut out = Features { value: &mut value, slope, bend, lane: 0, sums };
        self.encode::<R, Portable, 2>(table, &points, &mut out);
        let jet = |(f, value): (usize, &Row<R>)| {
            let [slope, bend] = [0, 1].map(|d| [0, 1, 2].map(|a| derivatives[d][f][a].0[0]));
            Jet { value: value.0[0], slope, bend }
        };
        value.iter().enumerate().map(jet).collect()
    }
}
