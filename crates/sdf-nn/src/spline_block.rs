//! The features of a grid of splines for a block of positions, and their derivatives.

use crate::grids::{Bars, Features, Points, Splines};
use field::TableSum;

use lanes::{GROUP, Group, Isa, LANES, Lane, Pass, Row};

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
    let factor = R::Group::<I>::splat(factor);
    for (vector, adjoint) in vectors.iter().zip(adjoint) {
        for (out, component) in out.iter_mut().zip(vector) {
            for g in 0..LANES / GROUP {
                let adjoint: R::Group<I> = adjoint.group(g);
                let sum = Group::fma(component.group(g), adjoint * factor, out.group(g));
                out.set_group(g, sum);
            }
        }
    }
}

/// Writes the features of a grid after the first `first` rows of `features`, in the first
/// `count` lanes. Others in the last group get finite numbers.
pub(crate) struct Values<'a, R> {
    pub(crate) splines: &'a Splines,
    pub(crate) coefficients: &'a [R],
    pub(crate) first: usize,
    pub(crate) count: usize,
    pub(crate) features: &'a mut [Row<R>],
}

impl<'a, R: Lane> Values<'a, R> {
    /// Writes the features and their derivatives up to an order. `motions` has the vectors of the
    /// points, for the order 2.
    #[inline(always)]
    fn write<I: Isa, const ORDER: usize>(
        self,
        motions: Option<&[Row<R>]>,
        slope: &mut [[Row<R>; 3]],
        bend: &mut [[Row<R>; 3]],
    ) {
        let (positions, value) = self.features.split_at_mut(self.first);
        let sums = [[[R::zero(); GROUP]; GROUP]; 6];
        let mut out = Features { value, slope, bend, lane: 0, sums };
        while out.lane < self.count {
            let points = points(positions, motions, out.lane, self.count);
            self.splines.encode::<R, I, ORDER>(self.coefficients, &points, &mut out);
            out.lane += GROUP;
        }
    }
}

/// The points of a group from the lane `first` on, of a block of `count` points, and the vectors of
/// the points.
#[inline(always)]
fn points<R: Lane>(
    positions: &[Row<R>],
    motions: Option<&[Row<R>]>,
    first: usize,
    count: usize,
) -> Points<R> {
    let zeros = [[R::zero(); GROUP]; 3];
    let mut points = Points { y: zeros, p: zeros, count: GROUP.min(count - first) };
    for a in 0..3 {
        points.y[a].copy_from_slice(&positions[a].0[first..first + GROUP]);
        if let Some(motions) = motions {
            points.p[a].copy_from_slice(&motions[a].0[first..first + GROUP]);
        }
    }
    points
}

impl<R: Lane> Pass for Values<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        self.write::<I, 0>(None, &mut [], &mut []);
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
        self.values.write::<I, 1>(None, &mut self.jets.slope, &mut []);
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
        let Tangents { values, tangent, jets: Jets { slope, bend } } = self;
        let (motions, tangent) = tangent.split_at_mut(values.first);
        if BEND {
            values.write::<I, 2>(Some(motions), slope, bend);
        } else {
            values.write::<I, 1>(None, slope, &mut []);
        }
        for (tangent, slope) in tangent.iter_mut().zip(slope) {
            let [x, y, z] = slope;
            for g in 0..LANES / GROUP {
                let flat = x.group::<R::Group<I>>(g) * motions[0].group(g);
                let along = Group::fma(y.group(g), motions[1].group(g), flat);
                tangent.set_group(g, R::Group::<I>::fma(z.group(g), motions[2].group(g), along));
            }
        }
    }
}

/// Adds the adjoints of the coefficients, from those of the features and their tangents in the
/// first `count` lanes.
pub(crate) struct Coefficients<'a, 'b, R> {
    pub(crate) splines: &'a Splines,
    pub(crate) first: usize,
    pub(crate) count: usize,
    /// The features and their tangents.
    pub(crate) features: &'a [Vec<Row<R>>; 2],
    pub(crate) adjoint: &'a [Vec<Row<R>>; 2],
    pub(crate) sums: &'a mut TableSum<'b, R>,
}

impl<R: Lane> Pass for Coefficients<'_, '_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let [features, tangent] = self.features;
        let [of_value, of_tangent] = self.adjoint;
        let sides = [&of_value[self.first..], &of_tangent[self.first..]];
        for lane in (0..self.count).step_by(GROUP) {
            let points = points(features, Some(tangent), lane, self.count);
            let bars = Bars { sides, lane };
            self.splines.encode_vjp::<R, I>(&points, bars, self.sums);
        }
    }
}
