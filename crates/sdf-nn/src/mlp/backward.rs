//! The backward sweep: adjoints of the outputs to adjoints of the features and parameters.
//!
//! With tangents this is reverse mode over forward mode. It gives Hessian–vector products: B. A.
//! Pearlmutter, “Fast exact multiplication by the Hessian”, Neural Computation 6(1), 1994.

use super::perceptron::Mlp;
use super::scratch::Scratch;
use lanes::{GROUP, Group, Isa, LANES, Lane, Row, TILE, multiply, outer, padded};

impl<R: Lane> Mlp<R> {
    /// VJP of the forward sweep: from the adjoints in the scratch's outputs to those of its
    /// features, in the first `N` lanes.
    ///
    /// With `TANGENT`, both the outputs and their tangents have adjoints. For an adjoint 1 of the
    /// tangent, the adjoint of the features' tangents (side 1) is the plain gradient, and that of
    /// the features (side 0) its change along the tangent. With `WEIGHTS`, the parameters' gradient
    /// is added to the scratch's; this needs `N` = `LANES`.
    #[inline(always)]
    pub(crate) fn backward<I: Isa, const N: usize, const TANGENT: bool, const WEIGHTS: bool>(
        &self,
        s: &mut Scratch<R>,
    ) {
        for side in 0..1 + usize::from(TANGENT) {
            s.adjoint[side].fill(Row::zero());
            let outputs = s.output[side].len();
            s.z_adjoint[side][..outputs].copy_from_slice(&s.output[side]);
        }
        for l in (0..self.layers.len()).rev() {
            if WEIGHTS {
                self.add_weight_gradient::<I, TANGENT>(l, s);
            }
            self.linear_vjp::<I, N, TANGENT>(l, s);
            self.add_feature_adjoints::<I, N, TANGENT>(l, s);
            if l == 0 {
                break;
            }
            self.activation_vjp::<I, N, TANGENT>(l, s);
        }
    }

    /// VJP of layer `l` to its weights and bias: adds to the scratch's gradients.
    #[inline(always)]
    fn add_weight_gradient<I: Isa, const TANGENT: bool>(&self, l: usize, s: &mut Scratch<R>) {
        let (layer, sides) = (&self.layers[l], 1 + usize::from(TANGENT));
        let rows = s.bias_gradient[l].len();
        for (row, bias) in s.z_adjoint[0].iter().zip(&mut s.bias_gradient[l]) {
            *bias += sum_of_lanes::<R, I>(row);
        }
        let size = LANES * padded(layer.inputs);
        for side in 0..sides {
            let to = &mut s.transposed[side * size..(side + 1) * size];
            R::transpose::<I>(&s.layers[l].input[side][..layer.inputs], to);
        }
        let both = [0, usize::from(TANGENT)]
            .map(|side| (&s.z_adjoint[side][..rows], &s.transposed[side * size..]));
        outer::<R, I>(&both[..sides], layer.outputs, layer.inputs, &mut s.weight_gradient[l]);
    }

    /// VJP of layer `l` to its input: Wᵀ times the adjoints of z, in the scratch's products.
    #[inline(always)]
    fn linear_vjp<I: Isa, const N: usize, const TANGENT: bool>(
        &self,
        l: usize,
        s: &mut Scratch<R>,
    ) {
        let (layer, weights) = (&self.layers[l], &self.packed[l].backward);
        let tiles = layer.inputs.div_ceil(TILE) * TILE;
        for side in 0..1 + usize::from(TANGENT) {
            let z_adjoint = &s.z_adjoint[side][..layer.outputs];
            let product = &mut s.product[side][..tiles];
            multiply::<R, I, N>(weights, &[], layer.inputs, z_adjoint, product);
        }
    }

    /// Adds the adjoints of the features among the inputs of layer `l`.
    #[inline(always)]
    fn add_feature_adjoints<I: Isa, const N: usize, const TANGENT: bool>(
        &self,
        l: usize,
        s: &mut Scratch<R>,
    ) {
        let columns = self.hidden_columns(l)..self.layers[l].inputs;
        for side in 0..1 + usize::from(TANGENT) {
            for (a, b) in s.adjoint[side].iter_mut().zip(&s.product[side][columns.clone()]) {
                for g in 0..N / GROUP {
                    a.set_group(g, a.group::<R::Group<I>>(g) + b.group(g));
                }
            }
        }
    }

    /// VJP of the activation below layer `l`: adjoints of its result, in the scratch's products, to
    /// adjoints of z of layer `l` − 1.
    #[inline(always)]
    fn activation_vjp<I: Isa, const N: usize, const TANGENT: bool>(
        &self,
        l: usize,
        s: &mut Scratch<R>,
    ) {
        let (hidden, below) = (self.hidden_columns(l), &s.layers[l - 1]);
        let [z_adjoint, of_tangent] = &mut s.z_adjoint;
        let [product, tangent] = &s.product;
        let tiles = hidden.div_ceil(TILE) * TILE;
        z_adjoint[hidden..tiles].fill(Row::zero());
        if TANGENT {
            of_tangent[hidden..tiles].fill(Row::zero());
        }
        // The compiler does not know that rows are apart, so it does not find the vectors here.
        for row in 0..hidden {
            for g in 0..N / GROUP {
                let slope: R::Group<I> = below.slope[row].group(g);
                let mut adjoint = product[row].group::<R::Group<I>>(g) * slope;
                if TANGENT {
                    let (tangent, curvature): (R::Group<I>, _) =
                        (tangent[row].group(g), below.curvature[row].group(g));
                    let z_tangent = below.z_tangent[row].group(g);
                    adjoint = Group::fma(tangent * curvature, z_tangent, adjoint);
                    of_tangent[row].set_group(g, tangent * slope);
                }
                z_adjoint[row].set_group(g, adjoint);
            }
        }
    }

    /// Adds the parameter gradient that the backward sweeps collected to the flat `adjoint`.
    pub(crate) fn collect_gradient(&self, s: &Scratch<R>, adjoint: &mut [R]) {
        for (l, layer) in self.layers.iter().enumerate() {
            let stride = padded(layer.inputs);
            let factors: Vec<R> = (0..layer.inputs).map(|c| self.column_factor(l, c)).collect();
            for r in 0..layer.outputs {
                let start = layer.start + r * layer.inputs;
                let row = &s.weight_gradient[l][r * stride..];
                for ((out, g), factor) in
                    adjoint[start..start + layer.inputs].iter_mut().zip(row).zip(&factors)
                {
                    *out += *g * *factor;
                }
                adjoint[layer.bias() + r] += s.bias_gradient[l][r];
            }
        }
    }
}

/// The sum over lanes, in a fixed order: first of the groups.
#[inline(always)]
fn sum_of_lanes<R: Lane, I: Isa>(row: &Row<R>) -> R {
    let halves: [R::Group<I>; 2] = [row.group(0), row.group(1)];
    let sum = (halves[0] + row.group(2)) + (halves[1] + row.group(3));
    let mut all = [R::zero(); GROUP];
    sum.store(&mut all);
    let [a, b, c, d, e, f, g, h] = all;
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}
