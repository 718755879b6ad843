//! The sweeps for a few points, at most four at once: lanes are the outputs of a layer, so few are
//! left empty.

use super::activate::Activate;
use super::perceptron::Mlp;
use super::scratch::{FewScratch, groups};
use lanes::{Isa, LANES, Lane, Row, multiply_few};

/// The rows of each of `P` points.
#[inline(always)]
fn of_points<R, const P: usize>(rows: &[Row<R>], groups: usize) -> [&[Row<R>]; P] {
    std::array::from_fn(|p| &rows[p * groups..(p + 1) * groups])
}

impl<R: Lane> Mlp<R> {
    /// Forward sweep of `P` points, whose features are in the lanes from `first` on. Writes the
    /// first output of each to `output`. With `STORE` it keeps the slopes for
    /// [`backward_few`](Self::backward_few).
    ///
    /// The bits are those of [`forward`](Self::forward).
    #[inline(always)]
    pub(crate) fn forward_few<I: Isa, const P: usize, const STORE: bool>(
        &self,
        features: &[Row<R>],
        first: usize,
        s: &mut FewScratch<R>,
        output: &mut [R],
    ) {
        self.put_features::<P>(0, features, first, &mut s.input[0]);
        for (l, layer) in self.layers.iter().enumerate() {
            let (packed, [inputs, outputs]) =
                (&self.packed[l], [layer.inputs, layer.outputs].map(groups));
            let (current, above) = s.input.split_at_mut(l + 1);
            let (input, z) = (of_points::<R, P>(&current[l], inputs), &mut s.product);
            multiply_few::<R, I, P>(&packed.columns, &packed.bias, input, z);
            let Some(next) = above.first_mut() else {
                for p in 0..P {
                    output[p] = z[p].0[0];
                }
                break;
            };
            let next_groups = groups(self.layers[l + 1].inputs);
            I::call(Activate::<R, LANES, STORE, false> {
                activation: self.activation,
                z: &z[..outputs * P],
                points: P,
                value: next,
                stride: next_groups,
                slope: &mut s.slope[l],
                curvature: &mut [],
            });
            if let Some(next) = above.first_mut().filter(|_| self.layers[l + 1].skip) {
                self.put_features::<P>(l + 1, features, first, next);
            }
        }
    }

    /// Copies the features of `P` points to their columns of the input of layer `l`.
    #[inline(always)]
    fn put_features<const P: usize>(
        &self,
        l: usize,
        features: &[Row<R>],
        first: usize,
        input: &mut [Row<R>],
    ) {
        let (hidden, groups) = (self.hidden_columns(l), groups(self.layers[l].inputs));
        for (f, row) in features[..self.features].iter().enumerate() {
            let column = hidden + f;
            for p in 0..P {
                input[p * groups + column / LANES].0[column % LANES] = row.0[first + p];
            }
        }
    }

    /// VJP of [`forward_few`](Self::forward_few) with an adjoint of 1: writes the gradient of the
    /// first output by the features to the lanes of `adjoint` from `first` on.
    #[inline(always)]
    pub(crate) fn backward_few<I: Isa, const P: usize>(
        &self,
        s: &mut FewScratch<R>,
        first: usize,
        adjoint: &mut [Row<R>],
    ) {
        for row in &mut *adjoint {
            row.0[first..first + P].fill(R::zero());
        }
        for z_adjoint in &mut s.z_adjoint[..P] {
            *z_adjoint = Row::zero();
            z_adjoint.0[0] = R::one();
        }
        for (l, layer) in self.layers.iter().enumerate().rev() {
            let [inputs, outputs] = [layer.inputs, layer.outputs].map(groups);
            let (of_outputs, zero) = (of_points::<R, P>(&s.z_adjoint, outputs), &s.zero[..inputs]);
            multiply_few::<R, I, P>(&self.packed[l].rows, zero, of_outputs, &mut s.product);
            let hidden = self.hidden_columns(l);
            for (row, column) in adjoint.iter_mut().zip(hidden..layer.inputs) {
                for p in 0..P {
                    row.0[first + p] += s.product[column / LANES * P + p].0[column % LANES];
                }
            }
            let below = groups(hidden);
            for i in 0..below * P {
                let (group, p) = (i / P, i % P);
                let slope = &s.slope[l - 1][i];
                for k in 0..LANES {
                    s.z_adjoint[p * below + group].0[k] = s.product[i].0[k] * slope.0[k];
                }
            }
        }
    }
}
