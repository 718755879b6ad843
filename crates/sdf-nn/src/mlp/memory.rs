//! Working memory for calls: what earlier calls have left, or new.

use super::perceptron::{LayerShape, Mlp};
use super::scratch::{
    FewMemory, FewScratch, LayerScratch, MAX_SWEEP_POINTS, Scratch, groups, rows, rows_if,
};
use crate::pool::Taken;
use lanes::{LANES, Lane, Row, TILE, padded};

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

    /// Working memory for the sweeps of a few points, with or without the backward sweep.
    pub(crate) fn few_memory(&self, store: bool) -> Taken<'_, FewMemory<R>> {
        self.few_memories[usize::from(store)].take(|| FewMemory {
            features: vec![Row::zero(); self.features],
            adjoint: vec![Row::zero(); if store { self.features } else { 0 }],
            scratch: self.few_scratch(store),
        })
    }

    fn few_scratch(&self, store: bool) -> FewScratch<R> {
        let rows = |n: usize| vec![Row::zero(); MAX_SWEEP_POINTS * groups(n)];
        let rows_if = |n: usize| if store { rows(n) } else { Vec::new() };
        let (widest, hidden) = (self.widest(), self.layers.len() - 1);
        FewScratch {
            input: self.layers.iter().map(|l| rows(l.inputs)).collect(),
            slope: self.layers[..hidden].iter().map(|l| rows_if(l.outputs)).collect(),
            z_adjoint: rows_if(widest),
            product: rows(widest),
            zero: vec![Row::zero(); groups(widest)],
        }
    }
}
