//! A multilayer perceptron on blocks of points: parameters, packing, and the forward and backward
//! sweeps.

use field::Real;

use crate::architecture::Activation;
use crate::kernel::{LANES, Row, TILE, fma, pack, padded};
use crate::math::Lane;
use crate::simd::Isa;

/// One layer's place in the network and in the flat parameter vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LayerShape {
    /// Rows of the weight matrix.
    pub(crate) outputs: usize,
    /// Columns of the weight matrix, with the skipped features if there are any.
    pub(crate) inputs: usize,
    /// Whether the input is [h, features]/√2.
    pub(crate) skip: bool,
    /// Where the weights start in the flat vector; the bias follows them.
    pub(crate) start: usize,
}

impl LayerShape {
    /// Where the bias starts in the flat vector.
    pub(crate) fn bias(&self) -> usize {
        self.start + self.outputs * self.inputs
    }
}

/// A layer's weights as the kernels want them.
#[derive(Clone, Debug, Default)]
struct Packed<R> {
    forward: Vec<[R; TILE]>,
    /// The transpose, for the backward sweep.
    backward: Vec<[R; TILE]>,
}

/// A perceptron from `features` inputs; hidden layers are activated, the last is linear.
#[derive(Clone, Debug)]
pub(crate) struct Mlp<R> {
    pub(crate) features: usize,
    pub(crate) layers: Vec<LayerShape>,
    pub(crate) activation: Activation,
    pub(crate) parameters: Vec<R>,
    /// A factor on every feature, folded into the weights that multiply it.
    window: Vec<R>,
    packed: Vec<Packed<R>>,
}

/// The working memory of one batch call: one block of points through all layers.
pub(crate) struct Scratch<R> {
    /// The input features and their tangents.
    pub(crate) features: [Vec<Row<R>>; 2],
    /// The adjoints of the features and of their tangents.
    pub(crate) adjoint: [Vec<Row<R>>; 2],
    /// The network's outputs and their tangents; before the backward sweep, their adjoints.
    pub(crate) output: [Vec<Row<R>>; 2],
    /// Adjoints of a layer's z and its tangent.
    delta: [Vec<Row<R>>; 2],
    layers: Vec<LayerScratch<R>>,
    /// Adjoints between layers, value and tangent.
    between: [Vec<Row<R>>; 2],
    transposed: Vec<R>,
    /// The weight gradient, layer after layer, in padded rows; biases behind.
    gradient: Vec<Vec<R>>,
    bias: Vec<Vec<R>>,
}

struct LayerScratch<R> {
    /// The layer's input and its tangent.
    input: [Vec<Row<R>>; 2],
    /// σ′(z), σ″(z) and the tangent of z.
    slope: Vec<Row<R>>,
    curve: Vec<Row<R>>,
    z_dot: Vec<Row<R>>,
}

fn rows<R: Real>(n: usize) -> Vec<Row<R>> {
    vec![Row::zero(); n.div_ceil(TILE) * TILE]
}

impl<R: Lane> Mlp<R> {
    /// A network of zeros; `skip` holds the indices of layers that see the features again.
    pub(crate) fn new(
        features: usize,
        hidden: &[usize],
        outputs: usize,
        skip: &[usize],
        activation: Activation,
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
        Mlp { features, layers, activation, parameters, window, packed }
    }

    /// The factor of the window in a column of a layer's weights.
    pub(crate) fn window_factor(&self, l: usize, column: usize) -> R {
        let own = self.own_columns(l);
        if column >= own { self.window[column - own] } else { R::one() }
    }

    /// The columns of a layer before those of the features.
    fn own_columns(&self, l: usize) -> usize {
        match &self.layers[l] {
            layer if layer.skip => layer.inputs - self.features,
            _ if l == 0 => 0,
            layer => layer.inputs,
        }
    }

    /// The factor that the packed weights carry in a column: the window, and 1/√2 where a skip
    /// comes in.
    fn column_factor(&self, l: usize, column: usize) -> R {
        let window = self.window_factor(l, column);
        if self.layers[l].skip { window * R::of(std::f64::consts::FRAC_1_SQRT_2) } else { window }
    }

    /// Sets the factors on the features.
    pub(crate) fn set_window(&mut self, window: Vec<R>) {
        if window != self.window {
            self.window = window;
            self.repack();
        }
    }

    /// Brings the packed weights up to date with the parameters.
    pub(crate) fn repack(&mut self) {
        let mut packed = std::mem::take(&mut self.packed);
        for (l, (layer, packed)) in self.layers.iter().zip(&mut packed).enumerate() {
            let factors: Vec<R> = (0..layer.inputs).map(|c| self.column_factor(l, c)).collect();
            let weight = |r: usize, c: usize| {
                self.parameters[layer.start + r * layer.inputs + c] * factors[c]
            };
            pack(layer.outputs, layer.inputs, weight, &mut packed.forward);
            pack(layer.inputs, layer.outputs, |r, c| weight(c, r), &mut packed.backward);
        }
        self.packed = packed;
    }

    /// Working memory for what the sweeps will be asked for, as their flags of these names say.
    pub(crate) fn scratch(&self, store: bool, tangent: bool, weights: bool) -> Scratch<R> {
        let rows_if = |needed: bool, n: usize| if needed { rows(n) } else { Vec::new() };
        let widest = self.layers.iter().map(|l| l.inputs.max(l.outputs)).max().unwrap_or(0);
        let outputs = self.layers.last().map_or(0, |l| l.outputs);
        let layers = self.layers.iter().map(|layer| LayerScratch {
            input: [rows(layer.inputs), rows_if(tangent, layer.inputs)],
            slope: rows_if(store, layer.outputs),
            curve: rows_if(tangent, layer.outputs),
            z_dot: rows_if(tangent, layer.outputs),
        });
        let sized = |size: &dyn Fn(&LayerShape) -> usize| -> Vec<Vec<R>> {
            self.layers.iter().map(|l| vec![R::zero(); if weights { size(l) } else { 0 }]).collect()
        };
        Scratch {
            features: [rows(self.features), rows_if(tangent, self.features)],
            adjoint: [rows(self.features), rows_if(tangent, self.features)],
            output: [rows(outputs), rows_if(tangent, outputs)],
            layers: layers.collect(),
            delta: [rows_if(store, widest), rows_if(tangent, widest)],
            between: [rows(widest), rows_if(tangent, widest)],
            transposed: vec![R::zero(); if weights { 2 * LANES * padded(widest) } else { 0 }],
            gradient: sized(&|l| l.outputs.div_ceil(TILE) * TILE * padded(l.inputs)),
            bias: sized(&|l| l.outputs.div_ceil(TILE) * TILE),
        }
    }

    /// Forward sweep from the scratch's features to its outputs; with `TANGENT`, their tangents
    /// too.
    ///
    /// The first `N` lanes only. With `STORE` the slopes that the backward sweep needs are kept.
    #[inline(always)]
    pub(crate) fn forward<I: Isa, const N: usize, const STORE: bool, const TANGENT: bool>(
        &self,
        s: &mut Scratch<R>,
    ) {
        let last = self.layers.len() - 1;
        for side in 0..1 + usize::from(TANGENT) {
            s.layers[0].input[side].copy_from_slice(&s.features[side]);
        }
        for l in 0..=last {
            let (layer, packed) = (&self.layers[l], &self.packed[l]);
            let bias = &self.parameters[layer.bias()..layer.bias() + layer.outputs];
            let (current, rest) = s.layers.split_at_mut(l + 1);
            let current = &mut current[l];
            let [value, tangent] = match rest.first_mut() {
                Some(next) => &mut next.input,
                None => &mut s.output,
            };
            // A skip's features follow the activations directly, so whole tiles are written to the
            // side first.
            let target = if l < last {
                &mut s.between[0][..layer.outputs.div_ceil(TILE) * TILE]
            } else {
                &mut value[..]
            };
            R::multiply::<I, N>(
                &packed.forward,
                bias,
                layer.outputs,
                &current.input[0][..layer.inputs],
                target,
            );
            if TANGENT {
                let input = &current.input[1][..layer.inputs];
                R::multiply::<I, N>(&packed.forward, &[], layer.outputs, input, &mut current.z_dot);
            }
            if l == last {
                if TANGENT {
                    tangent.copy_from_slice(&current.z_dot);
                }
                break;
            }
            let mut unused = [Row::zero(); 2];
            for row in 0..layer.outputs {
                let [slope, curve] = &mut unused;
                let slope = if STORE { &mut current.slope[row] } else { slope };
                let curve = if TANGENT { &mut current.curve[row] } else { curve };
                activate::<R, I, N, STORE, TANGENT>(
                    self.activation,
                    &s.between[0][row],
                    &mut value[row],
                    slope,
                    curve,
                );
                if TANGENT {
                    for i in 0..N {
                        tangent[row].0[i] = current.slope[row].0[i] * current.z_dot[row].0[i];
                    }
                }
            }
            if self.layers[l + 1].skip {
                value[layer.outputs..layer.outputs + self.features]
                    .copy_from_slice(&s.features[0][..self.features]);
                if TANGENT {
                    tangent[layer.outputs..layer.outputs + self.features]
                        .copy_from_slice(&s.features[1][..self.features]);
                }
            }
        }
    }

    /// Backward sweep from the adjoints in the scratch's outputs to those of its features.
    ///
    /// With `TANGENT` both the outputs and their tangents have adjoints: side 1 then carries the
    /// plain gradient, side 0 its change along the tangent. With `WEIGHTS` the parameters' gradient
    /// is added to the scratch's.
    #[inline(always)]
    pub(crate) fn backward<I: Isa, const N: usize, const TANGENT: bool, const WEIGHTS: bool>(
        &self,
        s: &mut Scratch<R>,
    ) {
        let sides = 1 + usize::from(TANGENT);
        for side in 0..sides {
            s.adjoint[side].fill(Row::zero());
            let outputs = s.output[side].len();
            s.delta[side][..outputs].copy_from_slice(&s.output[side]);
        }
        for l in (0..self.layers.len()).rev() {
            let (layer, packed) = (&self.layers[l], &self.packed[l]);
            if WEIGHTS {
                let rows = s.bias[l].len();
                for (row, bias) in s.delta[0].iter().zip(&mut s.bias[l]) {
                    *bias += sum(row);
                }
                let size = LANES * padded(layer.inputs);
                for side in 0..sides {
                    let to = &mut s.transposed[side * size..(side + 1) * size];
                    R::transpose::<I>(&s.layers[l].input[side][..layer.inputs], to);
                }
                let both = [0, usize::from(TANGENT)]
                    .map(|side| (&s.delta[side][..rows], &s.transposed[side * size..]));
                R::outer::<I>(&both[..sides], layer.outputs, layer.inputs, &mut s.gradient[l]);
            }
            let tiles = layer.inputs.div_ceil(TILE) * TILE;
            for side in 0..sides {
                let z = &s.delta[side][..layer.outputs];
                R::multiply::<I, N>(
                    &packed.backward,
                    &[],
                    layer.inputs,
                    z,
                    &mut s.between[side][..tiles],
                );
            }
            let own = self.own_columns(l);
            for side in 0..sides {
                for (a, b) in s.adjoint[side].iter_mut().zip(&s.between[side][own..layer.inputs]) {
                    for i in 0..N {
                        a.0[i] += b.0[i];
                    }
                }
            }
            if l == 0 {
                break;
            }
            let below = &s.layers[l - 1];
            for side in 0..sides {
                s.delta[side][own..own.div_ceil(TILE) * TILE].fill(Row::zero());
            }
            for row in 0..own {
                let slope = &below.slope[row].0;
                for i in 0..N {
                    s.delta[0][row].0[i] = s.between[0][row].0[i] * slope[i];
                }
                if TANGENT {
                    let (curve, z_dot) = (&below.curve[row].0, &below.z_dot[row].0);
                    for i in 0..N {
                        let tangent = s.between[1][row].0[i];
                        s.delta[1][row].0[i] = tangent * slope[i];
                        s.delta[0][row].0[i] =
                            fma::<R, I>(tangent * curve[i], z_dot[i], s.delta[0][row].0[i]);
                    }
                }
            }
        }
    }

    /// What the last layer saw of a lane, after a forward sweep.
    pub(crate) fn last_input(&self, s: &Scratch<R>, lane: usize) -> Vec<R> {
        let last = self.layers.len() - 1;
        s.layers[last].input[0][..self.layers[last].inputs].iter().map(|row| row.0[lane]).collect()
    }

    /// Adds the scratch's gradient to the flat `adjoint`.
    pub(crate) fn collect_gradient(&self, s: &Scratch<R>, adjoint: &mut [R]) {
        for (l, layer) in self.layers.iter().enumerate() {
            let stride = padded(layer.inputs);
            let factors: Vec<R> = (0..layer.inputs).map(|c| self.column_factor(l, c)).collect();
            for r in 0..layer.outputs {
                let start = layer.start + r * layer.inputs;
                let row = &s.gradient[l][r * stride..];
                for ((out, g), factor) in
                    adjoint[start..start + layer.inputs].iter_mut().zip(row).zip(&factors)
                {
                    *out += *g * *factor;
                }
                adjoint[layer.bias() + r] += s.bias[l][r];
            }
        }
    }
}

/// The sum over lanes, in a fixed order.
#[inline(always)]
fn sum<R: Real>(row: &Row<R>) -> R {
    row.0.iter().fold(R::zero(), |sum, v| sum + *v)
}

/// σ(z), and where they are needed σ′(z) and σ″(z).
#[inline(always)]
fn activate<R: Lane, I: Isa, const N: usize, const STORE: bool, const TANGENT: bool>(
    activation: Activation,
    z: &Row<R>,
    value: &mut Row<R>,
    slope: &mut Row<R>,
    curve: &mut Row<R>,
) {
    let one = R::one();
    match activation {
        Activation::Softplus { beta } => {
            let (beta, inverse) = (R::of(beta), R::of(1.0 / beta));
            for i in 0..N {
                let z = z.0[i];
                let e = R::exp_negative::<I>(beta * z.abs());
                let above = if z > R::zero() { z } else { R::zero() };
                // exp(−NaN) comes out as a number: 0 z is 0, or the NaN that has to come through.
                value.0[i] = fma::<R, I>(R::ln_one_plus::<I>(e), inverse, above) + z * R::zero();
                if STORE {
                    let high = one / (one + e);
                    let low = e * high;
                    slope.0[i] = if z > R::zero() { high } else { low };
                    if TANGENT {
                        curve.0[i] = beta * high * low;
                    }
                }
            }
        }
        Activation::Sine { omega } => {
            let omega = R::of(omega);
            for i in 0..N {
                let (sine, cosine) = R::sin_cos_moderate::<I>(omega * z.0[i]);
                value.0[i] = sine;
                if STORE {
                    slope.0[i] = omega * cosine;
                }
                if TANGENT {
                    curve.0[i] = -omega * omega * sine;
                }
            }
        }
        Activation::Relu => {
            for i in 0..N {
                let on = z.0[i] > R::zero();
                value.0[i] = if z.0[i] <= R::zero() { R::zero() } else { z.0[i] };
                if STORE {
                    slope.0[i] = if on { one } else { R::zero() };
                }
                if TANGENT {
                    curve.0[i] = R::zero();
                }
            }
        }
    }
}
