//! Initial weights.

use crate::architecture::{Activation, Architecture, Transform};
use crate::encode::points_in_ball;
use crate::kernel::LANES;
use crate::math::Lane;
use crate::mlp::Mlp;
use crate::network::Network;

/// A small generator (SplitMix64), so that a seed gives the same weights everywhere.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Random(seed)
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub(crate) fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Normal with variance 1.
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (2.0 * std::f64::consts::PI * self.uniform()).cos()
    }
}

/// Fills hidden layers so that activations neither grow nor fade with depth, and the last layer
/// with small numbers.
pub(crate) fn variance_preserving<R: Lane>(mlp: &mut Mlp<R>, random: &mut Random) {
    let last = mlp.layers.len() - 1;
    for (l, layer) in mlp.layers.clone().into_iter().enumerate() {
        let gain = match mlp.activation {
            Activation::Sine { omega } => 1.0 / omega,
            // Half of the inputs of a rectifier are cut off.
            Activation::Relu | Activation::Softplus { .. } => 1.0,
        };
        let spread = if l == last { 0.1 } else { gain } * (2.0 / layer.inputs as f64).sqrt();
        for weight in &mut mlp.parameters[layer.start..layer.bias()] {
            *weight = R::of(spread * random.normal());
        }
    }
}

impl<R: Lane> Network<R> {
    /// A network that starts as a sphere of `radius`, as a fraction of the unit ball: f ≈ |x| −
    /// radius.
    ///
    /// Hidden layers see the plain coordinates only (the encoding's waves start with weight zero)
    /// and are random with a variance that keeps lengths (Atzmon and Lipman 2020); their features
    /// are functions that grow linearly from the origin, among which |x| is the rotationally
    /// symmetric mean. Instead of taking that mean at infinite width, the last layer is the
    /// least-squares fit of |x| − radius over the ball, which is closer at any width.
    pub fn geometric(
        architecture: Architecture,
        transform: Transform,
        radius: f64,
        seed: u64,
    ) -> Self {
        let mut random = Random::new(seed);
        let mut network = Network::<f64>::zero(architecture.clone(), Transform::default(), 1.0);
        variance_preserving(&mut network.mlp, &mut random);
        let (features, first) = (network.mlp.features, network.mlp.layers[0]);
        let mlp = &mut network.mlp;
        for layer in mlp.layers.clone() {
            let own = if layer.start == first.start {
                0
            } else if layer.skip {
                layer.inputs - features
            } else {
                layer.inputs
            };
            for row in 0..layer.outputs {
                let row = layer.start + row * layer.inputs;
                // Three columns carry what the variance was spread over.
                if own == 0 {
                    let gain = R::of((layer.inputs as f64 / 3.0).sqrt()).to_double();
                    mlp.parameters[row..row + 3].iter_mut().for_each(|w| *w *= gain);
                }
                let waves = (own + 3).min(layer.inputs);
                mlp.parameters[row + waves..row + layer.inputs].fill(0.0);
            }
        }
        network.fit_last_layer(radius, &mut random);
        let mut out = Network::<R>::zero(architecture, transform, 1.0);
        let parameters: Vec<R> = network.mlp.parameters.iter().map(|p| R::of(*p)).collect();
        out.set_parameters(&parameters);
        out
    }
}

/// Points that the last layer is fitted to.
const FIT_POINTS: usize = 2048;

/// Ridge of the fit, as a fraction of the mean diagonal: enough to keep unused features near zero.
const RIDGE: f64 = 1e-4;

impl Network<f64> {
    /// Sets the last layer to the least-squares fit of |x| − radius.
    fn fit_last_layer(&mut self, radius: f64, random: &mut Random) {
        let Some(last) = self.mlp.layers.last().copied() else { return };
        let n = last.inputs + 1;
        let (mut normal, mut right) = (vec![0.0; n * n], vec![0.0; n]);
        self.mlp.repack();
        let mut scratch = self.mlp.scratch(false, false, false);
        for block in points_in_ball(FIT_POINTS, random).chunks(LANES) {
            self.forward_block(block, &mut scratch);
            for (lane, x) in block.iter().enumerate() {
                let mut row = self.mlp.last_input(&scratch, lane);
                row.push(1.0);
                let target = x.length() - radius;
                for i in 0..n {
                    right[i] += row[i] * target;
                    for j in 0..n {
                        normal[i * n + j] += row[i] * row[j];
                    }
                }
            }
        }
        let ridge = RIDGE * (0..n).map(|i| normal[i * n + i]).sum::<f64>() / n as f64;
        (0..n).for_each(|i| normal[i * n + i] += ridge);
        let solution = solve(&mut normal, right);
        self.mlp.parameters[last.start..].copy_from_slice(&solution);
        self.mlp.repack();
    }
}

/// Solves a symmetric positive definite system by Cholesky's factorisation, in place.
fn solve(matrix: &mut [f64], mut right: Vec<f64>) -> Vec<f64> {
    let n = right.len();
    for i in 0..n {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| matrix[i * n + k] * matrix[j * n + k]).sum();
            let rest = matrix[i * n + j] - dot;
            matrix[i * n + j] =
                if i == j { rest.max(f64::MIN_POSITIVE).sqrt() } else { rest / matrix[j * n + j] };
        }
    }
    for i in 0..n {
        let dot: f64 = (0..i).map(|k| matrix[i * n + k] * right[k]).sum();
        right[i] = (right[i] - dot) / matrix[i * n + i];
    }
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|k| matrix[k * n + i] * right[k]).sum();
        right[i] = (right[i] - dot) / matrix[i * n + i];
    }
    right
}
