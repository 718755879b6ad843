//! Initial parameters.

use glam::DVec3;
use random::Stream;

use crate::architecture::{Activation, Architecture, Encoding, Transform};
use crate::encode::Encoder;
use crate::mlp::{LayerShape, Mlp};
use crate::network::Network;
use lanes::{LANES, Lane, Portable};

/// The random number generator SplitMix64: a seed gives the same numbers on every machine.
///
/// Steele, Lea and Flood, “Fast splittable pseudorandom number generators”, OOPSLA 2014.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(stream: Stream) -> Self {
        Random(stream.bits())
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number with uniform density in [0, 1).
    pub(crate) fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A normal number with mean 0 and variance 1 (Box and Muller, “A note on the generation of
    /// random normal deviates”, Annals of Mathematical Statistics 29, 1958).
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (2.0 * std::f64::consts::PI * self.uniform()).cos()
    }
}

/// The factor of the last layer's random weights: a radiance head starts close to grey.
const LAST_LAYER_GAIN: f64 = 0.1;

/// Fills the weights with random numbers whose variance keeps the size of activations from layer to
/// layer. The last layer gets smaller numbers. The bias does not change.
///
/// The variance is 2/inputs: He et al., “Delving deep into rectifiers”, ICCV 2015, section 2.2.
pub(crate) fn variance_preserving<R: Lane>(mlp: &mut Mlp<R>, random: &mut Random) {
    let last = mlp.layers.len() - 1;
    for (l, layer) in mlp.layers.clone().into_iter().enumerate() {
        let gain = match mlp.activation {
            Activation::Sine { omega } => 1.0 / omega,
            // The 2 in the variance makes up for a ReLU that sets half of its inputs to 0.
            Activation::Relu | Activation::Softplus { .. } => 1.0,
        };
        let gain = if l == last { LAST_LAYER_GAIN } else { gain };
        let deviation = gain * (2.0 / layer.inputs as f64).sqrt();
        for weight in &mut mlp.parameters[layer.start..layer.bias()] {
            *weight = R::of(deviation * random.normal());
        }
    }
}

impl<R: Lane> Network<R> {
    /// A network that starts as a sphere about the centre of its ball: f ≈ |x| − `radius` in the
    /// unit ball, with `radius` a fraction of the ball's radius.
    ///
    /// The geometric initialisation of Atzmon and Lipman, “SAL: Sign Agnostic Learning of Shapes
    /// from Raw Data”, CVPR 2020: random hidden layers that keep lengths, and all weights of the
    /// encoding's waves zero. The hidden layers' outputs then grow linearly from the origin. SAL
    /// gives all of them the same weight in the last layer: their mean is a multiple of |x| at
    /// infinite width. Here the last layer is the least-squares fit of |x| − `radius` over the unit
    /// ball, which is closer at any width.
    ///
    /// The same `stream` gives the same network.
    pub fn geometric(
        architecture: Architecture,
        transform: Transform,
        radius: f64,
        stream: Stream,
    ) -> Self {
        let mut random = Random::new(stream);
        let mut out = Network::<R>::zero(architecture, transform, 1.0);
        let Architecture { encoding, hidden, skip, activation, .. } = &out.architecture;
        let features = out.architecture.features();
        let mut mlp = Mlp::<f64>::new(features, hidden, 1, skip, *activation, true);
        variance_preserving(&mut mlp, &mut random);
        ignore_waves::<R>(&mut mlp, encoding.features());
        fit_last_layer(&mut mlp, *encoding, radius, &mut random);
        let weights: Vec<R> = mlp.parameters.iter().map(|p| R::of(*p)).collect();
        // The coefficients of the grid are zero.
        out.set_weights(&weights);
        out
    }
}

/// Sets the weights of the encoding's waves to zero in all layers.
///
/// In the first layer the three coordinates' weights then get the variance of all its columns.
fn ignore_waves<R: Lane>(mlp: &mut Mlp<f64>, features: usize) {
    for (l, layer) in mlp.layers.clone().into_iter().enumerate() {
        let hidden = mlp.hidden_columns(l);
        for row in 0..layer.outputs {
            let row = layer.start + row * layer.inputs;
            if hidden == 0 {
                let gain = R::of((layer.inputs as f64 / 3.0).sqrt()).to_double();
                mlp.parameters[row..row + 3].iter_mut().for_each(|w| *w *= gain);
            }
            let waves = (hidden + 3).min(layer.inputs);
            let end = (hidden + features).min(layer.inputs);
            mlp.parameters[row + waves..row + end].fill(0.0);
        }
    }
}

/// Points that the last layer is fitted to.
const FIT_POINTS: usize = 2048;

/// Ridge of the fit, as a fraction of the matrix's mean diagonal: it keeps the weights of unused
/// features near zero.
const RIDGE: f64 = 1e-4;

/// Sets the last layer to the least-squares fit of |x| − `radius` over the unit ball.
fn fit_last_layer(mlp: &mut Mlp<f64>, encoding: Encoding, radius: f64, random: &mut Random) {
    let Some(last) = mlp.layers.last().copied() else { return };
    let n = last.inputs + 1;
    mlp.repack();
    let (mut matrix, right) = normal_equations(mlp, last, encoding, radius, random);
    let ridge = RIDGE * (0..n).map(|i| matrix[i * n + i]).sum::<f64>() / n as f64;
    (0..n).for_each(|i| matrix[i * n + i] += ridge);
    let solution = solve(&mut matrix, right);
    mlp.parameters[last.start..][..solution.len()].copy_from_slice(&solution);
}

/// The matrix and right-hand side of the fit's normal equations: weights first, then the bias.
///
/// The features of a grid are zero: no table of its coefficients is needed. Portable instructions
/// make the weights the same on every machine.
fn normal_equations(
    mlp: &Mlp<f64>,
    last: LayerShape,
    encoding: Encoding,
    radius: f64,
    random: &mut Random,
) -> (Vec<f64>, Vec<f64>) {
    let n = last.inputs + 1;
    let (mut matrix, mut right) = (vec![0.0; n * n], vec![0.0; n]);
    let encoder = Encoder::<f64>::new(encoding, &Transform::default());
    let mut scratch = mlp.scratch(false, false, false);
    for block in points_in_ball(FIT_POINTS, random).chunks(LANES) {
        encoder.encode::<Portable, LANES>(block, &mut scratch.features[0]);
        mlp.forward::<Portable, LANES, false, false>(&mut scratch);
        for (lane, x) in block.iter().enumerate() {
            let mut row = mlp.last_input(&scratch, lane);
            row.push(1.0);
            let target = x.length() - radius;
            for i in 0..n {
                right[i] += row[i] * target;
                for j in 0..n {
                    matrix[i * n + j] += row[i] * row[j];
                }
            }
        }
    }
    (matrix, right)
}

/// Points with uniform density in the unit ball.
fn points_in_ball(count: usize, random: &mut Random) -> Vec<DVec3> {
    let mut points = Vec::with_capacity(count);
    while points.len() < count {
        let p = DVec3::new(random.uniform(), random.uniform(), random.uniform()) * 2.0 - 1.0;
        if p.length_squared() <= 1.0 {
            points.push(p);
        }
    }
    points
}

/// Solves a linear system with a symmetric positive definite `matrix` by Cholesky factorisation.
/// The factor replaces the matrix.
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
