//! The working memory of the sweeps.

use field::Real;

use lanes::{LANES, Row, TILE};

/// The working memory of one call: one block of points in all layers.
///
/// A later call uses it again. It finds what the last block left, as a block finds what the block
/// before it left.
///
/// In every pair, element 0 belongs to the values and element 1 to their tangents. In comments
/// these are the two *sides* of a sweep.
#[derive(Default)]
pub(crate) struct Scratch<R> {
    /// The input features.
    pub(crate) features: [Vec<Row<R>>; 2],
    /// The adjoints of the features.
    pub(crate) adjoint: [Vec<Row<R>>; 2],
    /// The network's outputs; before the backward sweep the caller replaces them by their adjoints.
    pub(crate) output: [Vec<Row<R>>; 2],
    pub(super) layers: Vec<LayerScratch<R>>,
    /// The adjoints of one layer's z.
    pub(super) z_adjoint: [Vec<Row<R>>; 2],
    /// Results of matrix products, in whole tiles of rows: z of a hidden layer in the forward
    /// sweep, the adjoints of a layer's input in the backward sweep.
    pub(super) product: [Vec<Row<R>>; 2],
    /// The inputs of one layer, transposed: value side, then tangent side.
    pub(super) transposed: Vec<R>,
    /// The gradients of every layer's weights, in padded rows.
    pub(super) weight_gradient: Vec<Vec<R>>,
    /// The gradients of every layer's bias.
    pub(super) bias_gradient: Vec<Vec<R>>,
}

/// A layer's intermediate results that the backward sweep needs.
pub(super) struct LayerScratch<R> {
    /// The layer's input.
    pub(super) input: [Vec<Row<R>>; 2],
    /// σ′(z).
    pub(super) slope: Vec<Row<R>>,
    /// σ″(z).
    pub(super) curvature: Vec<Row<R>>,
    /// The tangent of z.
    pub(super) z_tangent: Vec<Row<R>>,
}

/// Rows of zeros: `n`, rounded up to whole tiles.
pub(super) fn rows<R: Real>(n: usize) -> Vec<Row<R>> {
    vec![Row::zero(); n.div_ceil(TILE) * TILE]
}

/// As [`rows`], or none.
pub(super) fn rows_if<R: Real>(needed: bool, n: usize) -> Vec<Row<R>> {
    if needed { rows(n) } else { Vec::new() }
}

/// The working memory of one call for a few points.
#[derive(Default)]
pub(crate) struct FewMemory<R> {
    /// The input features.
    pub(crate) features: Vec<Row<R>>,
    /// The adjoints of the features.
    pub(crate) adjoint: Vec<Row<R>>,
    pub(crate) scratch: FewScratch<R>,
}

/// The working memory of the sweeps for at most [`MAX_SWEEP_POINTS`] points at once.
///
/// The numbers of a point lie side by side in rows, and its rows follow those of the point before.
#[derive(Default)]
pub(crate) struct FewScratch<R> {
    /// The input of every layer.
    pub(super) input: Vec<Vec<Row<R>>>,
    /// σ′(z) of every hidden layer.
    pub(super) slope: Vec<Vec<Row<R>>>,
    /// The adjoints of one layer's z.
    pub(super) z_adjoint: Vec<Row<R>>,
    /// Results of matrix products, group after group: z in the forward sweep, the adjoints of a
    /// layer's input in the backward sweep.
    pub(super) product: Vec<Row<R>>,
    /// A start of zero for every group.
    pub(super) zero: Vec<Row<R>>,
}

/// The most points of a sweep. 8 would need 16 sums, all registers of AVX2.
pub(crate) const MAX_SWEEP_POINTS: usize = 4;

/// The number of rows that hold `n` numbers.
pub(super) fn groups(n: usize) -> usize {
    n.div_ceil(LANES)
}
