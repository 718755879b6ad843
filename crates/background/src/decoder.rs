//! The small network from the features of a point to its density and radiance.

use field::{Real, Vector3};

use crate::grid::INPUTS;

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

    /// VJP of (features; parameters) ↦ (density, radiance): returns the adjoint of the features,
    /// and adds that of the parameters to `sum`.
    pub(crate) fn vjp(
        &self,
        density: R,
        radiance: R::Vec3,
        parameters: &[R],
        sum: &mut [R],
    ) -> [R; INPUTS] {
        let mut adjoint = [R::zero(); OUTPUTS];
        adjoint[0] = density * sigmoid(self.output[0]);
        for (c, bar) in radiance.to_array().into_iter().enumerate() {
            let s = sigmoid(self.output[c + 1]);
            adjoint[c + 1] = bar * R::of(2.0) * s * s * (R::one() - s);
        }
        let mut hidden = [R::zero(); HIDDEN];
        for (o, bar) in adjoint.into_iter().enumerate() {
            let at = PLACES[2] + o * HIDDEN;
            for j in 0..HIDDEN {
                hidden[j] += bar * parameters[at + j];
                sum[at + j] += bar * self.hidden[j];
            }
            sum[PLACES[3] + o] += bar;
        }
        for (bar, h) in hidden.iter_mut().zip(&self.hidden) {
            *bar = if *h > R::zero() { *bar } else { R::zero() };
        }
        sum[PLACES[1]..PLACES[2]].iter_mut().zip(&hidden).for_each(|(sum, bar)| *sum += *bar);
        std::array::from_fn(|i| {
            let row = i * HIDDEN..(i + 1) * HIDDEN;
            let weights = &parameters[row.clone()];
            let own = sum[row].iter_mut().zip(&hidden);
            own.for_each(|(sum, bar)| *sum += *bar * self.features[i]);
            hidden.iter().zip(weights).fold(R::zero(), |sum, (h, w)| sum + *h * *w)
        })
    }
}

fn sigmoid<R: Real>(y: R) -> R {
    R::one() / (R::one() + (-y).exp())
}
