//! A perceptron: its layers, its parameters and their packed weights.

use std::ops::Range;

use super::scratch::{FewMemory, Scratch};
use crate::architecture::Activation;
use crate::pool::Pool;
use lanes::{Instructions, Lane, Row, TILE, pack, pack_columns};

/// The sizes of a layer z = W input + b, and its place in the flat parameter vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LayerShape {
    /// Rows of the weight matrix.
    pub(crate) outputs: usize,
    /// Columns of the weight matrix, including those of the features after a skip connection.
    pub(crate) inputs: usize,
    /// Whether the input is [h, features]/√2, with h the outputs of the layer below.
    pub(crate) skip: bool,
    /// Index of the first weight in the flat vector. The bias follows the weights.
    pub(crate) start: usize,
}

impl LayerShape {
    /// Index of the first element of the bias in the flat vector.
    pub(crate) fn bias(&self) -> usize {
        self.start + self.outputs * self.inputs
    }
}

/// A layer's weights, packed for the kernels.
#[derive(Clone, Debug, Default)]
pub(super) struct Packed<R> {
    /// W, for the forward sweep.
    pub(super) forward: Vec<[R; TILE]>,
    /// Wᵀ, for the backward sweep.
    pub(super) backward: Vec<[R; TILE]>,
    /// W in columns, for the forward sweep of a few points.
    pub(super) columns: Vec<Row<R>>,
    /// The bias, beside the columns.
    pub(super) bias: Vec<Row<R>>,
    /// W in rows, for the backward sweep of a few points.
    pub(super) rows: Vec<Row<R>>,
}

/// A perceptron: hidden layers with activation, then a linear layer.
#[derive(Clone, Debug)]
pub(crate) struct Mlp<R> {
    /// The number of inputs.
    pub(crate) features: usize,
    pub(crate) layers: Vec<LayerShape>,
    pub(crate) activation: Activation,
    /// The instructions of all passes.
    pub(crate) instructions: Instructions,
    /// θ: layer after layer the weights (row-major), then the bias.
    pub(crate) parameters: Vec<R>,
    /// A factor for every feature, folded into the packed weights of its columns.
    pub(super) window: Vec<R>,
    /// Whether the weights are packed for a few points too: a radiance head has no such sweep.
    has_few: bool,
    /// Up to date with `parameters` only after [`Mlp::repack`].
    pub(super) packed: Vec<Packed<R>>,
    /// Working memory, by the flags of the sweeps.
    pub(super) scratches: [Pool<Scratch<R>>; 8],
    /// Working memory for a few points: of values, and of gradients.
    pub(super) few_memories: [Pool<FewMemory<R>>; 2],
}

impl<R: Lane> Mlp<R> {
    /// A perceptron with all parameters zero; layers with indices in `skip` have the features as
    /// additional inputs. With `has_few` it has the sweeps for a few points.
    pub(crate) fn new(
        features: usize,
        hidden: &[usize],
        outputs: usize,
        skip: &[usize],
        activation: Activation,
        has_few: bool,
    ) -> Self {
        let (mut layers, mut width, mut start) = (Vec::new(), features, 0);
        for (i, &out) in hidden.iter().chain([&outputs]).enumerate() {
            let skip = i > 0 && skip.contains(&i);
            let inputs = width + if skip { features } else { 0 };
            let layer = LayerShape { outputs: out, inputs, skip, start };
            start = layer.bias() + out;
            width = out;
            layers.push(layer);
        }
        let packed = layers.iter().map(|_| Packed::default()).collect();
        let (parameters, window) = (vec![R::zero(); start], vec![R::one(); features]);
        let instructions = Instructions::widest();
        Mlp {
            features,
            layers,
            activation,
            instructions,
            parameters,
            window,
            has_few,
            packed,
            scratches: Default::default(),
            few_memories: Default::default(),
        }
    }

    /// The weights of layer after layer: their places among the parameters and their numbers of
    /// columns.
    pub(crate) fn matrices(&self) -> impl Iterator<Item = (Range<usize>, usize)> + '_ {
        self.layers.iter().map(|layer| (layer.start..layer.bias(), layer.inputs))
    }

    /// The most inputs or outputs of a layer.
    pub(super) fn widest(&self) -> usize {
        self.layers.iter().map(|l| l.inputs.max(l.outputs)).max().unwrap_or(0)
    }

    /// The window's factor for a column of the weights of layer `l`.
    pub(crate) fn window_factor(&self, l: usize, column: usize) -> R {
        let hidden = self.hidden_columns(l);
        if column >= hidden { self.window[column - hidden] } else { R::one() }
    }

    /// The number of columns of layer `l` before those of the features.
    pub(crate) fn hidden_columns(&self, l: usize) -> usize {
        match &self.layers[l] {
            layer if layer.skip => layer.inputs - self.features,
            _ if l == 0 => 0,
            layer => layer.inputs,
        }
    }

    /// The factor of a column of the packed weights of layer `l`: the window's, times 1/√2 in a
    /// layer with a skip connection.
    pub(super) fn column_factor(&self, l: usize, column: usize) -> R {
        let window = self.window_factor(l, column);
        if self.layers[l].skip { window * R::of(std::f64::consts::FRAC_1_SQRT_2) } else { window }
    }

    /// The factors of the features.
    pub(crate) fn window(&self) -> &[R] {
        &self.window
    }

    /// Sets the factors of the features.
    pub(crate) fn set_window(&mut self, window: Vec<R>) {
        if window != self.window {
            self.window = window;
            self.repack();
        }
    }

    /// Packs the weights again. Call this after every change of the parameters.
    pub(crate) fn repack(&mut self) {
        let mut packed = std::mem::take(&mut self.packed);
        for (l, (layer, packed)) in self.layers.iter().zip(&mut packed).enumerate() {
            let factors: Vec<R> = (0..layer.inputs).map(|c| self.column_factor(l, c)).collect();
            let weight = |r: usize, c: usize| {
                self.parameters[layer.start + r * layer.inputs + c] * factors[c]
            };
            pack(layer.outputs, layer.inputs, weight, &mut packed.forward);
            pack(layer.inputs, layer.outputs, |r, c| weight(c, r), &mut packed.backward);
            if !self.has_few {
                continue;
            }
            pack_columns(layer.outputs, layer.inputs, weight, &mut packed.columns);
            pack_columns(layer.inputs, layer.outputs, |r, c| weight(c, r), &mut packed.rows);
            let bias = &self.parameters[layer.bias()..][..layer.outputs];
            pack_columns(layer.outputs, 1, |r, _| bias[r], &mut packed.bias);
        }
        self.packed = packed;
    }
}
