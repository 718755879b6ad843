//! The forward sweep: features to outputs, layer by layer.

use super::activate::Activate;
use super::perceptron::Mlp;
use super::scratch::LayerScratch;
use super::scratch::Scratch;
use lanes::{GROUP, Isa, Lane, Row, TILE, multiply};

impl<R: Lane> Mlp<R> {
    /// Forward sweep from the scratch's features to its outputs, in the first `N` lanes.
    ///
    /// With `STORE` it keeps the intermediate results for the backward sweep. With `TANGENT` it
    /// also computes the tangents of the outputs from those of the features (a JVP).
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
            let (current, above) = s.layers.split_at_mut(l + 1);
            let current = &mut current[l];
            let [value, tangent] = match above.first_mut() {
                Some(next) => &mut next.input,
                None => &mut s.output,
            };
            // A product writes whole tiles of rows. In the next layer's input these can overlap the
            // features of a skip connection, so a hidden layer writes z elsewhere.
            let z = if l < last {
                &mut s.product[0][..self.layers[l].outputs.div_ceil(TILE) * TILE]
            } else {
                &mut value[..]
            };
            self.linear::<I, N, TANGENT>(l, current, z);
            if l == last {
                if TANGENT {
                    tangent.copy_from_slice(&current.z_tangent);
                }
                break;
            }
            let z = &s.product[0];
            self.activate_layer::<I, N, STORE, TANGENT>(l, current, z, value, tangent);
            if self.layers[l + 1].skip {
                let place = self.layers[l].outputs..self.layers[l].outputs + self.features;
                value[place.clone()].copy_from_slice(&s.features[0][..self.features]);
                if TANGENT {
                    tangent[place].copy_from_slice(&s.features[1][..self.features]);
                }
            }
        }
    }

    /// z = W input + b of layer `l`, and with `TANGENT` the tangent of z.
    #[inline(always)]
    fn linear<I: Isa, const N: usize, const TANGENT: bool>(
        &self,
        l: usize,
        current: &mut LayerScratch<R>,
        z: &mut [Row<R>],
    ) {
        let (layer, weights) = (&self.layers[l], &self.packed[l].forward);
        let bias = &self.parameters[layer.bias()..layer.bias() + layer.outputs];
        let input = &current.input[0][..layer.inputs];
        multiply::<R, I, N>(weights, bias, layer.outputs, input, z);
        if TANGENT {
            let input = &current.input[1][..layer.inputs];
            multiply::<R, I, N>(weights, &[], layer.outputs, input, &mut current.z_tangent);
        }
    }

    /// σ(z) of hidden layer `l` and, with `TANGENT`, its tangent, as the next layer's input.
    #[inline(always)]
    fn activate_layer<I: Isa, const N: usize, const STORE: bool, const TANGENT: bool>(
        &self,
        l: usize,
        current: &mut LayerScratch<R>,
        z: &[Row<R>],
        value: &mut [Row<R>],
        tangent: &mut [Row<R>],
    ) {
        let rows = self.layers[l].outputs;
        I::call(Activate::<R, N, STORE, TANGENT> {
            activation: self.activation,
            z: &z[..rows],
            points: 1,
            value,
            stride: 0,
            slope: &mut current.slope,
            curvature: &mut current.curvature,
        });
        if TANGENT {
            for row in 0..rows {
                for g in 0..N / GROUP {
                    let slope: R::Group<I> = current.slope[row].group(g);
                    tangent[row].set_group(g, slope * current.z_tangent[row].group(g));
                }
            }
        }
    }
}
