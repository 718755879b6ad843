//! The features of a grid of splines for a block of positions, and their derivatives.

use crate::grids::{Jet, Splines};
use field::{Real, TableSum};

use lanes::{Isa, LANES, Lane, Pass, Row, fma};

/// The derivatives of the features of a grid by the position in the unit ball, for a block.
pub(crate) struct Jets<R> {
    /// The gradients.
    slope: Vec<[Row<R>; 3]>,
    /// The products of the Hessians with the tangents of the positions.
    bend: Vec<[Row<R>; 3]>,
}

impl<R: Lane> Jets<R> {
    /// Working memory for features of these splines.
    pub(crate) fn new(splines: &Splines, slope: bool, bend: bool) -> Self {
        let count = splines.size().feature_count();
        let rows = |on: bool| vec![[Row::zero(); 3]; if on { count } else { 0 }];
        Jets { slope: rows(slope), bend: rows(bend) }
    }

    /// Adds the VJP of the features to the positions, times `factor`, to `out`; `adjoint` holds
    /// the adjoints of the features.
    #[inline(always)]
    pub(crate) fn add_vjp<I: Isa>(&self, adjoint: &[Row<R>], factor: R, out: &mut [Row<R>; 3]) {
        add_products::<R, I>(&self.slope, adjoint, factor, out);
    }

    /// Adds the VJP of the features' tangents to the positions, times `factor`, to `out`;
    /// `adjoint` holds the adjoints of these tangents.
    #[inline(always)]
    pub(crate) fn add_vjp_of_jvp<I: Isa>(
        &self,
        adjoint: &[Row<R>],
        factor: R,
        out: &mut [Row<R>; 3],
    ) {
        add_products::<R, I>(&self.bend, adjoint, factor, out);
    }
}

/// Adds the sum of vectors times adjoints, times `factor`, to `out`.
#[inline(always)]
fn add_products<R: Lane, I: Isa>(
    vectors: &[[Row<R>; 3]],
    adjoint: &[Row<R>],
    factor: R,
    out: &mut [Row<R>; 3],
) {
    for (vector, adjoint) in vectors.iter().zip(adjoint) {
        for (out, component) in out.iter_mut().zip(vector) {
            for l in 0..LANES {
                out.0[l] = fma::<R, I>(component.0[l], adjoint.0[l] * factor, out.0[l]);
            }
        }
    }
}

/// Writes the features of a grid after the first `first` rows of `features`, in the first
/// `count` lanes.
pub(crate) struct Values<'a, R> {
    pub(crate) splines: &'a Splines,
    pub(crate) coefficients: &'a [R],
    pub(crate) first: usize,
    pub(crate) count: usize,
    pub(crate) features: &'a mut [Row<R>],
}

impl<R: Lane> Pass for Values<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let (positions, features) = self.features.split_at_mut(self.first);
        for l in 0..self.count {
            let y = lane(positions, l);
            let put = |i: usize, jet: Jet<R>| features[i].0[l] = jet.value;
            self.splines.encode::<R, 0>(self.coefficients, y, [R::zero(); 3], put);
        }
    }
}

/// Writes the features as [`Values`], and their gradients.
pub(crate) struct Slopes<'a, R> {
    pub(crate) values: Values<'a, R>,
    pub(crate) jets: &'a mut Jets<R>,
}

impl<R: Lane> Pass for Slopes<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let Values { splines, coefficients, first, count, features } = self.values;
        let (positions, features) = features.split_at_mut(first);
        for l in 0..count {
            let y = lane(positions, l);
            let put = |i: usize, jet: Jet<R>| {
                features[i].0[l] = jet.value;
                (0..3).for_each(|a| self.jets.slope[i][a].0[l] = jet.slope[a]);
            };
            splines.encode::<R, 1>(coefficients, y, [R::zero(); 3], put);
        }
    }
}

/// Writes the features as [`Values`], their gradients and tangents, and with `BEND` the products of
/// their Hessians with the tangents of the positions.
pub(crate) struct Tangents<'a, R, const BEND: bool> {
    pub(crate) values: Values<'a, R>,
    pub(crate) tangent: &'a mut [Row<R>],
    pub(crate) jets: &'a mut Jets<R>,
}

impl<R: Lane, const BEND: bool> Pass for Tangents<'_, R, BEND> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let Values { splines, coefficients, first, count, features } = self.values;
        let (positions, features) = features.split_at_mut(first);
        let (motions, tangent) = self.tangent.split_at_mut(first);
        for l in 0..count {
            let (y, p) = (lane(positions, l), lane(motions, l));
            let put = |i: usize, jet: Jet<R>| {
                features[i].0[l] = jet.value;
                tangent[i].0[l] = (0..3).fold(R::zero(), |sum, a| sum + jet.slope[a] * p[a]);
                (0..3).for_each(|a| self.jets.slope[i][a].0[l] = jet.slope[a]);
                if BEND {
                    (0..3).for_each(|a| self.jets.bend[i][a].0[l] = jet.bend[a]);
                }
            };
            if BEND {
                splines.encode::<R, 2>(coefficients, y, p, put);
            } else {
                splines.encode::<R, 1>(coefficients, y, p, put);
            }
        }
    }
}

/// Adds the adjoints of the coefficients, from those of the features and their tangents in the
/// first `count` lanes.
#[inline(always)]
pub(crate) fn add_coefficients<R: Lane>(
    splines: &Splines,
    first: usize,
    count: usize,
    [features, tangent]: &[Vec<Row<R>>; 2],
    [adjoint, of_tangent]: &[Vec<Row<R>>; 2],
    sums: &mut TableSum<'_, R>,
) {
    for l in 0..count {
        let (y, p) = (lane(features, l), lane(tangent, l));
        let adjoint = |i: usize| [adjoint[first + i].0[l], of_tangent[first + i].0[l]];
        splines.encode_vjp(y, p, adjoint, sums);
    }
}

/// The first three rows at a lane: the position in the unit ball, or its tangent.
#[inline(always)]
fn lane<R: Real>(rows: &[Row<R>], l: usize) -> [R; 3] {
    [rows[0].0[l], rows[1].0[l], rows[2].0[l]]
}
