//! The small network from the features of a point to its density and radiance.

use field::{Real, Vector3};

use crate::background::grid::INPUTS;

/// Width of the hidden layer.
const HIDDEN: usize = 32;

/// Density, red, green and blue, before their activations.
const OUTPUTS: usize = 4;

/// The places of the first weights, the first bias, the second weights and the second bias.
const PLACES: [usize; 4] =
    [0, INPUTS * HIDDEN, (INPUTS + 1) * HIDDEN, (INPUTS + 1 + OUTPUTS) * HIDDEN];

/// The number of parameters.
pub(crate) const LENGTH: usize = PLACES[3] + OUTPUTS;

/// The place of the bias of the density.
pub(crate) const DENSITY_BIAS: usize = PLACES[3];

/// The largest random weight of each parameter at the start: variance-preserving for the layers,
/// with half of it for the outputs, and 0 for biases.
pub(crate) fn initial_range(parameter: usize) -> f64 {
    match PLACES.iter().rposition(|place| *place <= parameter) {
        Some(0) => (6.0 / INPUTS as f64).sqrt(),
        Some(2) => 0.5 * (6.0 / HIDDEN as f64).sqrt(),
        _ => 0.0,
    }
}

/// A point of the volume, with the numbers that its reverse mode needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Decoded<R: Real> {
    features: [R; INPUTS],
    hidden: [R; HIDDEN],
    output: [R; OUTPUTS],
}

/// The adjoints of a point's features, hidden layer and outputs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DecodedAdjoint<R: Real> {
    pub(crate) features: [R; INPUTS],
    hidden: [R; HIDDEN],
    output: [R; OUTPUTS],
}

impl<R: Real> Decoded<R> {
    /// The point with these features. `parameters` are those of the decoder.
    pub(crate) fn of(features: [R; INPUTS], parameters: &[R]) -> Self {
        let mut hidden = [R::zero(); HIDDEN];
        hidden.copy_from_slice(&parameters[PLACES[1]..PLACES[2]]);
        let rows = parameters[..PLACES[1]].chunks_exact(HIDDEN);
        for (feature, row) in features.iter().zip(rows) {
            hidden.iter_mut().zip(row).for_each(|(h, w)| *h += *feature * *w);
        }
        hidden.iter_mut().for_each(|h| *h = h.max(R::zero()));
        let mut output = [R::zero(); OUTPUTS];
        output.copy_from_slice(&parameters[PLACES[3]..LENGTH]);
        let rows = parameters[PLACES[2]..PLACES[3]].chunks_exact(HIDDEN);
        for (output, row) in output.iter_mut().zip(rows) {
            *output += hidden.iter().zip(row).fold(R::zero(), |sum, (h, w)| sum + *h * *w);
        }
        Decoded { features, hidden, output }
    }

    /// The density: the softplus of the first output, per bounding radius.
    pub(crate) fn density(&self) -> R {
        let y = self.output[0];
        y.max(R::zero()) + (-y.abs()).exp().ln_1p()
    }

    /// The radiance: sigmoid² of the other outputs, linear RGB.
    pub(crate) fn radiance(&self) -> R::Vec3 {
        let [_, r, g, b] = self.output.map(sigmoid);
        R::Vec3::new(r * r, g * g, b * b)
    }

    /// VJP of features ↦ (density, radiance). `parameters` are those of the decoder.
    pub(crate) fn vjp(&self, density: R, radiance: R::Vec3, parameters: &[R]) -> DecodedAdjoint<R> {
        let mut output = [R::zero(); OUTPUTS];
        output[0] = density * sigmoid(self.output[0]);
        for (c, bar) in radiance.to_array().into_iter().enumerate() {
            let s = sigmoid(self.output[c + 1]);
            output[c + 1] = bar * R::of(2.0) * s * s * (R::one() - s);
        }
        let mut hidden = [R::zero(); HIDDEN];
        for (bar, row) in output.iter().zip(parameters[PLACES[2]..].chunks_exact(HIDDEN)) {
            hidden.iter_mut().zip(row).for_each(|(sum, w)| *sum += *bar * *w);
        }
        for (bar, h) in hidden.iter_mut().zip(&self.hidden) {
            *bar = if *h > R::zero() { *bar } else { R::zero() };
        }
        let features = std::array::from_fn(|i| {
            let row = &parameters[i * HIDDEN..(i + 1) * HIDDEN];
            hidden.iter().zip(row).fold(R::zero(), |sum, (h, w)| sum + *h * *w)
        });
        DecodedAdjoint { features, hidden, output }
    }

    /// Adds the adjoint of the parameters to `sum`, from those of the layers.
    pub(crate) fn parameter_vjp(&self, adjoint: &DecodedAdjoint<R>, sum: &mut [R]) {
        add_layer(&self.features, &adjoint.hidden, &mut sum[..PLACES[1]]);
        add(&adjoint.hidden, &mut sum[PLACES[1]..PLACES[2]]);
        add_layer(&adjoint.output, &self.hidden, &mut sum[PLACES[2]..PLACES[3]]);
        add(&adjoint.output, &mut sum[PLACES[3]..]);
    }
}

/// Adds a vector to `sum`.
fn add<R: Real>(vector: &[R], sum: &mut [R]) {
    sum.iter_mut().zip(vector).for_each(|(sum, v)| *sum += *v);
}

/// Adds the outer product of two vectors to `sum`: a row of [`HIDDEN`] for each of `rows`.
fn add_layer<R: Real>(rows: &[R], hidden: &[R; HIDDEN], sum: &mut [R]) {
    for (row, sum) in rows.iter().zip(sum.chunks_exact_mut(HIDDEN)) {
        sum.iter_mut().zip(hidden).for_each(|(sum, h)| *sum += *row * *h);
    }
}

fn sigmoid<R: Real>(y: R) -> R {
    R::one() / (R::one() + (-y).exp())
}
