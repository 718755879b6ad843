//! A perceptron as a signed distance field.

use std::ops::Range;

use crate::grids::Splines;
use field::Real;
use glam::DVec3;

use crate::architecture::{Architecture, Transform};
use crate::encode::{Encoder, lane};
use crate::mlp::{Mlp, Scratch};
use crate::spline_block::{self, Jets};
use lanes::{Instructions, Isa, LANES, Lane, Row};

/// A multilayer perceptron as a signed distance: f(x) = r · net((x − c)/r)/scale, in world units.
///
/// c and r are the centre and radius of its [`Transform`]. f is meant for this ball only. Outside,
/// evaluation works, but the values have no meaning.
#[derive(Clone, Debug)]
pub struct Network<R: Real> {
    pub(crate) architecture: Architecture,
    pub(crate) transform: Transform,
    /// Units of the perceptron's output per unit of distance in the unit ball.
    pub(crate) scale: f64,
    pub(crate) mlp: Mlp<R>,
    /// θ: the weights of the perceptron, then the free coefficients of the grid.
    parameters: Vec<R>,
    /// All coefficients of the grid.
    pub(crate) table: Vec<R>,
    pub(crate) splines: Splines,
    pub(crate) encoder: Encoder<R>,
}

impl<R: Lane> Network<R> {
    /// A network whose parameters are all zero.
    pub(crate) fn zero(architecture: Architecture, transform: Transform, scale: f64) -> Self {
        let mlp = Mlp::new(
            architecture.features(),
            &architecture.hidden,
            1,
            &architecture.skip,
            architecture.activation,
            true,
        );
        let encoder = Encoder::new(architecture.encoding, &transform);
        let splines = Splines::new(architecture.grid.clone());
        let parameters = vec![R::zero(); mlp.parameters.len() + splines.free_count()];
        let table = splines.table();
        Network { architecture, transform, scale, mlp, parameters, table, splines, encoder }
    }

    /// The encoding, layers and activation.
    pub fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    /// The map from world space to the unit ball.
    pub fn transform(&self) -> &Transform {
        &self.transform
    }

    /// The same network for points relative to `origin`, a point in world units.
    #[must_use]
    pub fn about(mut self, origin: DVec3) -> Self {
        self.transform = self.transform.about(origin);
        self.encoder = Encoder::new(self.architecture.encoding, &self.transform);
        self
    }

    /// The same network with passes of these instructions, in place of the widest of this machine.
    /// Results differ by rounding.
    #[must_use]
    pub fn with_instructions(mut self, instructions: Instructions) -> Self {
        self.mlp.instructions = instructions;
        self
    }

    /// All parameters: layer after layer the weights (outputs × inputs, row-major), then the bias;
    /// then the free coefficients of the grid.
    pub fn parameters(&self) -> &[R] {
        &self.parameters
    }

    /// Sets all parameters.
    ///
    /// # Panics
    /// If `parameters` has another length than [`parameters`](Self::parameters).
    pub fn set_parameters(&mut self, parameters: &[R]) {
        let (weights, free) = parameters.split_at(self.mlp.parameters.len());
        self.set_weights(weights);
        self.parameters[weights.len()..].copy_from_slice(free);
        self.splines.expand(free, &mut self.table);
    }

    /// Sets the weights of the perceptron, and no coefficient of the grid.
    pub(crate) fn set_weights(&mut self, weights: &[R]) {
        self.parameters[..weights.len()].copy_from_slice(weights);
        self.mlp.parameters.copy_from_slice(weights);
        self.mlp.repack();
    }

    /// Sets the weight, in [0, 1], of every octave of the encoding, for training from coarse to
    /// fine. A new network has weights 1.
    ///
    /// The weights are part of f. A saved file has no entry for them: they are multiplied into its
    /// tensors.
    ///
    /// # Panics
    /// If `weights` does not have one element for each octave.
    pub fn set_band_weights(&mut self, weights: &[R]) {
        assert_eq!(weights.len(), self.architecture.encoding.bands(), "number of octave weights");
        let window = Encoder::window(weights);
        let mut all = self.mlp.window().to_vec();
        all[..window.len()].copy_from_slice(&window);
        self.mlp.set_window(all);
    }

    /// Sets the free nodes of a level of the grid: a flag for each node, x slowest. The free
    /// coefficients are the last parameters, level by level. A node that becomes free has zeros,
    /// and one that is not free any more loses its coefficients.
    ///
    /// # Panics
    /// If the number of flags is wrong.
    pub fn set_free_nodes(&mut self, level: usize, is_free: &[bool]) {
        self.splines.set_free_nodes(level, is_free);
        self.splines.clear_others(level, &mut self.table);
        self.gather_parameters();
    }

    /// Sets the parameters from the weights of the perceptron and the table.
    pub(crate) fn gather_parameters(&mut self) {
        let weights = &self.mlp.parameters;
        let mut parameters = Vec::with_capacity(weights.len() + self.splines.free_count());
        parameters.extend_from_slice(weights);
        self.splines.gather_into(&self.table, &mut parameters);
        self.parameters = parameters;
    }

    /// The splines of the grid.
    pub fn splines(&self) -> &Splines {
        &self.splines
    }

    /// The number of weights of the perceptron: the first parameters. The others are the free
    /// coefficients of the grid.
    pub fn weight_count(&self) -> usize {
        self.mlp.parameters.len()
    }

    /// The weight matrices of layer after layer: the place of each among the parameters, row-major,
    /// and its number of columns.
    pub fn matrices(&self) -> impl Iterator<Item = (Range<usize>, usize)> + '_ {
        self.mlp.matrices()
    }

    /// The number of features before those of the grid.
    pub(crate) fn first_of_grid(&self) -> usize {
        self.architecture.encoding.features()
    }

    /// World units of f per unit of the perceptron's output.
    pub(crate) fn output_factor(&self) -> R {
        R::of(self.transform.radius / self.scale)
    }

    /// The part of a pass that writes the features of the grid after those of the encoding, in the
    /// first `count` lanes.
    #[inline(always)]
    pub(crate) fn grid_values<'a>(
        &'a self,
        count: usize,
        features: &'a mut [Row<R>],
    ) -> spline_block::Values<'a, R> {
        let (splines, coefficients) = (&self.splines, &self.table[..]);
        spline_block::Values { splines, coefficients, first: self.first_of_grid(), count, features }
    }

    /// The output of one block: a forward sweep.
    #[inline(always)]
    pub(crate) fn block_values<I: Isa, const N: usize>(&self, x: &[R::Vec3], s: &mut Scratch<R>) {
        self.encoder.encode::<I, N>(x, &mut s.features[0]);
        I::call(self.grid_values(x.len(), &mut s.features[0]));
        self.mlp.forward::<I, N, false, false>(s);
    }

    /// Value and gradient of one block: a forward and a backward sweep.
    #[inline(always)]
    pub(crate) fn block_gradient<I: Isa, const N: usize>(
        &self,
        x: &[R::Vec3],
        (s, jets): (&mut Scratch<R>, &mut Jets<R>),
        f: &mut [R],
        gradient: &mut [R::Vec3],
    ) {
        let factor = self.output_factor();
        self.encoder.encode::<I, N>(x, &mut s.features[0]);
        let values = self.grid_values(x.len(), &mut s.features[0]);
        I::call(spline_block::Slopes { values, jets });
        self.mlp.forward::<I, N, true, false>(s);
        for (f, y) in f.iter_mut().zip(s.output[0][0].0) {
            *f = y * factor;
        }
        s.output[0][0].0 = [R::one(); LANES];
        self.mlp.backward::<I, N, false, false>(s);
        self.write_gradients::<I>(&s.features[0], &s.adjoint[0], jets, gradient);
    }

    /// Writes the gradients in the first lanes from the adjoints of the features.
    #[inline(always)]
    pub(crate) fn write_gradients<I: Isa>(
        &self,
        features: &[Row<R>],
        adjoint: &[Row<R>],
        jets: &Jets<R>,
        gradient: &mut [R::Vec3],
    ) {
        let (factor, first) = (self.output_factor(), self.first_of_grid());
        let mut g = self.encoder.encode_vjp::<I>(features, adjoint, factor);
        jets.add_vjp::<I>(&adjoint[first..], factor * self.encoder.inverse_radius(), &mut g);
        for (l, gradient) in gradient.iter_mut().enumerate() {
            *gradient = lane(&g, l);
        }
    }

    /// Forward sweep of one block with tangents along `p`, and the backward sweep of α f + p·∇f.
    ///
    /// Without `alpha`, α is 0.
    #[inline(always)]
    pub(crate) fn block_tangent<I: Isa, const N: usize, const WEIGHTS: bool>(
        &self,
        x: &[R::Vec3],
        p: &[R::Vec3],
        alpha: &[R],
        (s, jets): (&mut Scratch<R>, &mut Jets<R>),
    ) {
        let factor = self.output_factor();
        self.encoder.encode::<I, N>(x, &mut s.features[0]);
        let [features, tangent] = &mut s.features;
        self.encoder.encode_jvp::<I, N>(p, features, tangent);
        // Lanes without a point keep the grid's features of the block before. These are finite, and
        // have the adjoint 0.
        let [features, tangent] = &mut s.features;
        let values = self.grid_values(x.len(), features);
        if WEIGHTS {
            I::call(spline_block::Tangents::<R, false> { values, tangent, jets });
        } else {
            I::call(spline_block::Tangents::<R, true> { values, tangent, jets });
        }
        self.mlp.forward::<I, N, true, true>(s);
        for l in 0..LANES {
            // Lanes without a point must not add to the parameters' gradient.
            let on = !WEIGHTS || l < x.len();
            s.output[0][0].0[l] = alpha.get(l).map_or(R::zero(), |a| *a * factor);
            s.output[1][0].0[l] = if on { factor } else { R::zero() };
        }
        self.mlp.backward::<I, N, true, WEIGHTS>(s);
    }
}
