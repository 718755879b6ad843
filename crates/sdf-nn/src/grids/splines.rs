//! Features that are uniform B-splines on grids of several resolutions.
//!
//! A level has R coefficients along a side of the cube [−1, 1]³, for each feature. The splines of
//! degree n (2 or 3) have R − n equal intervals along a side; de Boor, "A Practical Guide to
//! Splines", chapter IX, has their basis. A feature and its gradient are continuous, and so is its
//! Hessian for the degree 3.

use std::ops::Range;

use field::{Real, TableSum};
use lanes::{Isa, Lane};
use rayon::prelude::*;

use crate::grids::adjoints::Bars;
use crate::grids::support::Support;
use crate::grids::taps::{Features, PADDING, Places, Points, Rows};

/// The most coefficients along a side of a level.
pub const MOST_COEFFICIENTS: usize = 512;

/// The most features of a level.
pub const MOST_FEATURES: usize = 16;

/// Nodes near the surface, in units of the nodes of a square across the ball: the area of a sphere
/// of its size times the nodes across the band.
const NODES_OF_SQUARE: u64 = 19;

/// Bytes of memory for each coefficient of a level, free or not: the tables of the model, its
/// copies, and the model file that is written.
const MEMORY_PER_COEFFICIENT: u64 = 16;

/// The degree of the splines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Degree {
    /// Continuous gradients: 27 coefficients for a value.
    Quadratic,
    /// Continuous Hessians: 64 coefficients for a value.
    Cubic,
}

impl Degree {
    /// Coefficients of a value along an axis.
    pub(crate) fn taps(self) -> usize {
        match self {
            Degree::Quadratic => 3,
            Degree::Cubic => 4,
        }
    }

    /// The degree as a number.
    pub fn number(self) -> usize {
        self.taps() - 1
    }
}

/// The size of splines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SplineSize {
    /// Coefficients along a side, level by level.
    pub levels: Vec<usize>,
    /// Features of a level.
    pub features: usize,
    /// The degree.
    pub degree: Degree,
}

impl SplineSize {
    /// No splines.
    pub fn none() -> Self {
        SplineSize { levels: Vec::new(), features: 1, degree: Degree::Quadratic }
    }

    /// The number of features of all levels.
    pub fn feature_count(&self) -> usize {
        self.features * self.levels.len()
    }

    /// The number of coefficients of all levels.
    pub fn coefficient_count(&self) -> usize {
        self.levels.iter().map(|side| side.pow(3) * self.features).sum()
    }

    /// An estimate of the memory of splines that are fitted, in bytes. The nodes of levels that
    /// `is_fine` are free near a surface only; `of_parameter` is the memory for a parameter.
    pub fn memory(&self, is_fine: impl Fn(usize) -> bool, of_parameter: u64) -> u64 {
        let of_level = |side: &usize| {
            let all = (*side as u64).pow(3);
            let near = (NODES_OF_SQUARE * (*side as u64).pow(2)).min(all);
            let free = if is_fine(*side) { near } else { all };
            self.features as u64 * (free * of_parameter + all * MEMORY_PER_COEFFICIENT)
        };
        self.levels.iter().map(of_level).sum()
    }

    /// The place of each level among the coefficients: side × side × side × features, x slowest.
    pub fn ranges(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        self.levels.iter().scan(0, |next, side| {
            let start = *next;
            *next += side.pow(3) * self.features;
            Some(start..*next)
        })
    }
}

/// A level of splines.
#[derive(Clone, Debug)]
struct Level {
    /// Coefficients along a side, for each feature.
    side: usize,
    /// The index of its first coefficient.
    start: usize,
    /// The index of its first free coefficient, among those of all levels.
    first_free: usize,
    /// The nodes whose coefficients are free.
    support: Support,
}

impl Level {
    /// The places of a group, by axis.
    #[inline(always)]
    fn places<R: Lane, I: Isa, const T: usize>(
        &self,
        points: &Points<R>,
    ) -> [Places<R::Group<I>>; 3] {
        let [x, y, z] = &points.y;
        [Places::new(x, self.side, T), Places::new(y, self.side, T), Places::new(z, self.side, T)]
    }

    /// The points among the first `count` of a group that may have a free node, as bits.
    #[inline(always)]
    fn met<V>(&self, [x, y, z]: &[Places<V>; 3], count: usize) -> u32 {
        let reaches = |l: usize| {
            self.support.reaches([x.first[l], y.first[l], z.first[l]].map(|i| i as usize))
        };
        (0..count).fold(0, |bits, l| bits | u32::from(reaches(l)) << l)
    }
}

/// Splines on grids: features of a point of the unit ball from coefficients.
///
/// A coefficient belongs to a node: a place of a level with a coefficient for each feature. The
/// nodes of a level can be *free* near a surface only. Free coefficients are the parameters; the
/// others are zero. Features come from a table of all coefficients, so they need no search, and a
/// point without a free node nearby costs next to nothing.
#[derive(Clone, Debug)]
pub struct Splines {
    size: SplineSize,
    levels: Vec<Level>,
}

impl Splines {
    /// Splines of this size.
    ///
    /// # Panics
    /// If a level has less coefficients along a side than a value takes, or more than
    /// [`MOST_COEFFICIENTS`], or if there are no features or more than [`MOST_FEATURES`].
    pub fn new(size: SplineSize) -> Self {
        let least = size.degree.taps();
        let is_valid = |side: &usize| (least..=MOST_COEFFICIENTS).contains(side);
        assert!(size.levels.iter().all(is_valid), "coefficients of splines: {size:?}");
        assert!((1..=MOST_FEATURES).contains(&size.features), "features of splines: {size:?}");
        let level = |(side, range): (&usize, Range<usize>)| Level {
            side: *side,
            start: range.start,
            first_free: range.start,
            support: Support::all(*side),
        };
        Splines { levels: size.levels.iter().zip(size.ranges()).map(level).collect(), size }
    }

    /// The size.
    pub fn size(&self) -> &SplineSize {
        &self.size
    }

    /// The number of free coefficients.
    pub fn free_count(&self) -> usize {
        self.free_counts().sum()
    }

    /// The number of free coefficients of each level.
    pub fn free_counts(&self) -> impl Iterator<Item = usize> + '_ {
        self.levels.iter().map(|level| level.support.count() * self.size.features)
    }

    /// The middle of the splines of a node of a level, in the cube, by the node's index, x slowest.
    pub fn node(&self, level: usize, index: usize) -> [f64; 3] {
        let side = self.levels[level].side;
        let index = [index / side / side, index / side % side, index % side];
        // The first spline ends one interval inside the cube, for each degree.
        let before = 0.5 * (self.size.degree.number() as f64 - 1.0);
        index.map(|i| (i as f64 - before) * self.interval(level) - 1.0)
    }

    /// The distance along an axis from the middle of a spline to its end: half of its support.
    pub fn reach(&self, level: usize) -> f64 {
        0.5 * self.size.degree.taps() as f64 * self.interval(level)
    }

    /// The length of an interval of a level.
    fn interval(&self, level: usize) -> f64 {
        2.0 / (self.levels[level].side - self.size.degree.number()) as f64
    }

    /// Whether each node of a level is free, x slowest.
    pub fn free_nodes(&self, level: usize) -> Vec<bool> {
        self.levels[level].support.flags()
    }

    /// Sets the free nodes of a level: a flag for each node, x slowest. The coefficients of the
    /// others are zero.
    ///
    /// # Panics
    /// If the number of flags is wrong.
    pub fn set_free_nodes(&mut self, level: usize, is_free: &[bool]) {
        self.levels[level].support = Support::of_nodes(self.levels[level].side, is_free);
        let mut next = 0;
        for level in &mut self.levels {
            level.first_free = next;
            next += level.support.count() * self.size.features;
        }
    }

    /// Writes the free coefficients into the table of all coefficients. The others stay.
    pub fn expand<R: Real>(&self, free: &[R], table: &mut [R]) {
        let features = self.size.features;
        for Level { side, start, first_free, support } in &self.levels {
            let free = &free[*first_free..];
            let plane = side * side;
            // A plane of nodes, with x alike, has consecutive coefficients in both.
            let planes =
                table[*start..][..side * plane * features].par_chunks_mut(plane * features);
            planes.enumerate().for_each(|(x, table)| {
                let (first, spans) = support.spans_between(x * plane..(x + 1) * plane);
                let mut free = &free[first * features..];
                for span in spans {
                    let (own, rest) = free.split_at(span.len() * features);
                    let at = (span.start - x * plane) * features;
                    table[at..at + own.len()].copy_from_slice(own);
                    free = rest;
                }
            });
        }
    }

    /// The free coefficients of a table of all coefficients.
    pub fn gather<R: Real>(&self, table: &[R]) -> Vec<R> {
        let mut free = Vec::with_capacity(self.free_count());
        self.gather_into(table, &mut free);
        free
    }

    /// Adds the free coefficients of a table of all coefficients to `free`.
    pub(crate) fn gather_into<R: Real>(&self, table: &[R], free: &mut Vec<R>) {
        let features = self.size.features;
        for Level { start, support, .. } in &self.levels {
            let of_node = |node| &table[start + node * features..][..features];
            support.nodes().for_each(|node| free.extend_from_slice(of_node(node)));
        }
    }

    /// Sets the coefficients of nodes of a level that are not free to zero, in a table of all
    /// coefficients. Zeros are not written: at the start of a fit, the system has no pages for them
    /// yet.
    pub(crate) fn clear_others<R: Real>(&self, level: usize, table: &mut [R]) {
        let (features, Level { side, start, support, .. }) =
            (self.size.features, &self.levels[level]);
        let nodes = table[*start..][..side.pow(3) * features].chunks_exact_mut(features);
        for (node, coefficients) in nodes.enumerate() {
            let is_zero = coefficients.iter().all(|c| *c == R::zero());
            if !is_zero && !support.is_free(node) {
                coefficients.fill(R::zero());
            }
        }
    }

    /// A table of all coefficients, all zero.
    pub fn table<R: Real>(&self) -> Vec<R> {
        vec![R::zero(); self.size.coefficient_count() + PADDING]
    }

    /// Writes the features of a group of points: values for the `ORDER` 0, also gradients for 1,
    /// also products of Hessians with the vectors of the points for 2.
    #[inline(always)]
    pub(crate) fn encode<R: Lane, I: Isa, const ORDER: usize>(
        &self,
        table: &[R],
        points: &Points<R>,
        out: &mut Features<'_, R>,
    ) {
        match self.size.degree {
            Degree::Quadratic => self.encode_taps::<R, I, 3, ORDER>(table, points, out),
            Degree::Cubic => self.encode_taps::<R, I, 4, ORDER>(table, points, out),
        }
    }

    #[inline(always)]
    fn encode_taps<R: Lane, I: Isa, const T: usize, const ORDER: usize>(
        &self,
        table: &[R],
        points: &Points<R>,
        out: &mut Features<'_, R>,
    ) {
        let features = self.size.features;
        for (l, level) in self.levels.iter().enumerate() {
            let axes = level.places::<R, I, T>(points);
            let met = level.met(&axes, points.count);
            let rows = Rows { side: level.side, start: level.start, features };
            rows.write::<R, I, T, ORDER>(table, &axes, (met, &points.p), l * features, out);
        }
    }

    /// VJP of [`encode`](Self::encode) to the free coefficients: adds to `sums`. `bars` has, for
    /// each feature, the adjoint of its value and that of its gradient along the vector.
    #[inline(always)]
    pub(crate) fn encode_vjp<R: Lane, I: Isa>(
        &self,
        points: &Points<R>,
        bars: Bars<'_, R>,
        sums: &mut TableSum<'_, R>,
    ) {
        match self.size.degree {
            Degree::Quadratic => self.vjp_taps::<R, I, 3>(points, bars, sums),
            Degree::Cubic => self.vjp_taps::<R, I, 4>(points, bars, sums),
        }
    }

    #[inline(always)]
    fn vjp_taps<R: Lane, I: Isa, const T: usize>(
        &self,
        points: &Points<R>,
        bars: Bars<'_, R>,
        sums: &mut TableSum<'_, R>,
    ) {
        let features = self.size.features;
        for (l, level) in self.levels.iter().enumerate() {
            let axes = level.places::<R, I, T>(points);
            let bars = bars.of(l * features, features);
            let met = level.met(&axes, points.count) & bars.met();
            if met != 0 {
                let rows = Rows { side: level.side, start: level.first_free, features };
                rows.add::<R, I, T>(&level.support, &axes, (met, &points.p), bars, sums);
            }
        }
    }
}
