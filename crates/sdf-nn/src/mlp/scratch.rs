//! The working memory of the sweeps.

use field::Real;

use super::perceptron::{LayerShape, Mlp};
use crate::pool::Taken;
use lanes::{LANES, Lane, Row, TILE, padded};

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
fn rows<R: Real>(n: usize) -> Vec<Row<R>> {
    vec![Row::zero(); n.div_ceil(TILE) * TILE]
}

/// As [`rows`], or none.
fn rows_if<R: Real>(needed: bool, n: usize) -> Vec<Row<R>> {
    if needed { rows(n) } else { Vec::new() }
}

impl<R: Lane> Mlp<R> {
    /// Working memory for sweeps with the flags `STORE`, `TANGENT` and `WEIGHTS` of these values.
    /// The features and the gradients of the weights are zero.
    pub(crate) fn scratch(
        &self,
        store: bool,
        tangent: bool,
        weights: bool,
    ) -> Taken<'_, Scratch<R>> {
        let kind = [store, tangent, weights].map(usize::from);
        let pool = &self.scratches[kind[0] + 2 * kind[1] + 4 * kind[2]];
        let mut is_new = false;
        let mut scratch = pool.take(|| {
            is_new = true;
            self.new_scratch(store, tangent, weights)
        });
        if !is_new {
            // Lanes without a point keep features of a grid. Those of an earlier call may be NaNs.
            scratch.features.iter_mut().for_each(|rows| rows.fill(Row::zero()));
            let s = &mut *scratch;
            let sums = s.weight_gradient.iter_mut().chain(&mut s.bias_gradient);
            sums.for_each(|sums| sums.fill(R::zero()));
        }
        scratch
    }

    fn new_scratch(&self, store: bool, tangent: bool, weights: bool) -> Scratch<R> {
        let widest = self.widest();
        let outputs = self.layers.last().map_or(0, |l| l.outputs);
        let layers = self.layers.iter().map(|layer| LayerScratch {
            input: [rows(layer.inputs), rows_if(tangent, layer.inputs)],
            slope: rows_if(store, layer.outputs),
            curvature: rows_if(tangent, layer.outputs),
            z_tangent: rows_if(tangent, layer.outputs),
        });
        let per_layer = |size: &dyn Fn(&LayerShape) -> usize| -> Vec<Vec<R>> {
            self.layers.iter().map(|l| vec![R::zero(); if weights { size(l) } else { 0 }]).collect()
        };
        Scratch {
            features: [rows(self.features), rows_if(tangent, self.features)],
            adjoint: [rows(self.features), rows_if(tangent, self.features)],
            output: [rows(outputs), rows_if(tangent, outputs)],
            layers: layers.collect(),
            z_adjoint: [rows_if(store, widest), rows_if(tangent, widest)],
            product: [rows(widest), rows_if(tangent, widest)],
            transposed: vec![R::zero(); if weights { 2 * LANES * padded(widest) } else { 0 }],
            weight_gradient: per_layer(&|l| l.outputs.div_ceil(TILE) * TILE * padded(l.inputs)),
            bias_gradient: per_layer(&|l| l.outputs.div_ceil(TILE) * TILE),
        }
    }

    /// The last layer's input in one lane, after a forward sweep.
    pub(crate) fn last_input(&self, s: &Scratch<R>, lane: usize) -> Vec<R> {
        let last = self.layers.len() - 1;
        s.layers[last].input[0][..self.layers[last].inputs].iter().map(|row| row.0[lane]).collect()
    }
}
