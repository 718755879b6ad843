//! A perceptron as a signed distance field.

use std::ops::Range;

use crate::grids::Splines;
use field::{Field, PartialSum, Real, Sphere, TableSum, Vector3};
use glam::DVec3;

use crate::architecture::{Architecture, Transform};
use crate::encode::{Encoder, lane};
use crate::few_points::{FewPoints, block_points};
use crate::grid::{self, Jets};
use crate::mlp::{Mlp, Scratch};
use crate::passes::{AnyPass, PassKind, Passes};
use lanes::{HALF, Instructions, Isa, LANES, Lane, Pass, Portable, Row};

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
        self.transform.center -= origin;
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
        self.parameters.copy_from_slice(parameters);
        let (weights, free) = parameters.split_at(self.mlp.parameters.len());
        self.mlp.parameters.copy_from_slice(weights);
        self.mlp.repack();
        self.splines.expand(free, &mut self.table);
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
        let free = self.splines.gather(&self.table);
        self.table.fill(R::zero());
        self.splines.expand(&free, &mut self.table);
        self.parameters.truncate(self.mlp.parameters.len());
        self.parameters.extend(free);
    }

    /// Sets the parameters from the weights of the perceptron and the table.
    pub(crate) fn gather_parameters(&mut self) {
        self.parameters = [&self.mlp.parameters[..], &self.splines.gather(&self.table)].concat();
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

    /// The number of features before those of the grid.
    pub(crate) fn first_of_grid(&self) -> usize {
        self.architecture.encoding.features()
    }

    /// World units of f per unit of the perceptron's output.
    pub(crate) fn output_factor(&self) -> R {
        R::of(self.transform.radius / self.scale)
    }

    /// Forward sweep of one block with portable instructions, so that initial weights do not depend
    /// on the machine's vector instructions.
    pub(crate) fn forward_block(&self, x: &[R::Vec3], s: &mut Scratch<R>) {
        self.encoder.encode::<Portable, LANES>(x, &mut s.features[0]);
        Portable::call(self.grid_values(x.len(), &mut s.features[0]));
        self.mlp.forward::<Portable, LANES, false, false>(s);
    }

    /// The part of a pass that writes the features of the grid after those of the encoding, in the
    /// first `count` lanes.
    #[inline(always)]
    pub(crate) fn grid_values<'a>(
        &'a self,
        count: usize,
        features: &'a mut [Row<R>],
    ) -> grid::Values<'a, R> {
        let (splines, coefficients) = (&self.splines, &self.table[..]);
        grid::Values { splines, coefficients, first: self.first_of_grid(), count, features }
    }

    /// The output of one block: a forward sweep.
    #[inline(always)]
    fn block_values<I: Isa, const N: usize>(&self, x: &[R::Vec3], s: &mut Scratch<R>) {
        self.encoder.encode::<I, N>(x, &mut s.features[0]);
        I::call(self.grid_values(x.len(), &mut s.features[0]));
        self.mlp.forward::<I, N, false, false>(s);
    }

    /// Value and gradient of one block: a forward and a backward sweep.
    #[inline(always)]
    fn block_gradient<I: Isa, const N: usize>(
        &self,
        x: &[R::Vec3],
        (s, jets): (&mut Scratch<R>, &mut Jets<R>),
        f: &mut [R],
        gradient: &mut [R::Vec3],
    ) {
        let factor = self.output_factor();
        self.encoder.encode::<I, N>(x, &mut s.features[0]);
        let values = self.grid_values(x.len(), &mut s.features[0]);
        I::call(grid::Slopes { values, jets });
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
    fn block_tangent<I: Isa, const N: usize, const WEIGHTS: bool>(
        &self,
        x: &[R::Vec3],
        p: &[R::Vec3],
        alpha: &[R],
        (s, jets): (&mut Scratch<R>, &mut Jets<R>),
    ) {
        let factor = self.output_factor();
        self.encoder.encode::<I, LANES>(x, &mut s.features[0]);
        let [features, tangent] = &mut s.features;
        self.encoder.encode_jvp(p, features, tangent);
        // Lanes without a point keep the grid's features of the block before. These are finite, and
        // have the adjoint 0.
        let [features, tangent] = &mut s.features;
        let values = self.grid_values(x.len(), features);
        if WEIGHTS {
            I::call(grid::Tangents::<R, false> { values, tangent, jets });
        } else {
            I::call(grid::Tangents::<R, true> { values, tangent, jets });
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

impl<R: Passes> Field<R> for Network<R> {
    fn parameter_count(&self) -> usize {
        self.parameters.len()
    }

    fn bounds(&self) -> Option<Sphere<R>> {
        let center = <R::Vec3 as Vector3<R>>::of(self.transform.center);
        Some(Sphere { center, radius: R::of(self.transform.radius) })
    }

    fn value(&self, x: &[R::Vec3], f: &mut [R]) {
        R::run(AnyPass(PassKind::Value(Value { network: self, x, f })));
    }

    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]) {
        let pass = ValueGradient { network: self, x, f, gradient };
        R::run(AnyPass(PassKind::ValueGradient(pass)));
    }

    fn hessian_vector(
        &self,
        x: &[R::Vec3],
        p: &[R::Vec3],
        gradient: &mut [R::Vec3],
        product: &mut [R::Vec3],
    ) {
        let pass = HessianVector { network: self, x, p, gradient, product };
        R::run(AnyPass(PassKind::HessianVector(pass)));
    }

    fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]) {
        assert_eq!(adjoint.len(), self.parameter_count(), "number of parameter adjoints");
        let (weights, table) = adjoint.split_at_mut(self.weight_count());
        let table = TableSum::Vector(table);
        let pass = ParameterVjp { network: self, x, alpha, c, weights, table };
        R::run(AnyPass(PassKind::ParameterVjp(pass)));
    }

    fn table(&self) -> Range<usize> {
        self.weight_count()..self.parameter_count()
    }

    fn add_parameter_vjp(
        &self,
        x: &[R::Vec3],
        alpha: &[R],
        c: &[R::Vec3],
        sum: &mut PartialSum<R>,
    ) {
        assert_eq!(sum.place(), self.table(), "place of the grid's coefficients");
        if !x.is_empty() {
            let (weights, table) = (&mut sum.others[..], TableSum::Additions(&mut sum.table));
            let pass = ParameterVjp { network: self, x, alpha, c, weights, table };
            R::run(AnyPass(PassKind::ParameterVjp(pass)));
        }
    }
}

/// The pass of [`Field::value`].
pub(crate) struct Value<'a, R: Real> {
    pub(crate) network: &'a Network<R>,
    pub(crate) x: &'a [R::Vec3],
    pub(crate) f: &'a mut [R],
}

impl<R: Lane> Pass for Value<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let (network, factor) = (self.network, self.network.output_factor());
        let (mut scratch, mut few) = (None, None);
        for (x, f) in self.x.chunks(LANES).zip(self.f.chunks_mut(LANES)) {
            let count = block_points(x.len());
            let ((x, few_x), (f, few_f)) = (x.split_at(count), f.split_at_mut(count));
            if !few_x.is_empty() {
                let few = few.get_or_insert_with(|| FewPoints::new(network, false));
                few.values::<I>(network, few_x, few_f);
            }
            if x.is_empty() {
                continue;
            }
            let s = scratch.get_or_insert_with(|| network.mlp.scratch(false, false, false));
            if x.len() <= HALF {
                network.block_values::<I, HALF>(x, s);
            } else {
                network.block_values::<I, LANES>(x, s);
            }
            for (f, y) in f.iter_mut().zip(s.output[0][0].0) {
                *f = y * factor;
            }
        }
    }
}

/// The pass of [`Field::value_gradient`].
pub(crate) struct ValueGradient<'a, R: Real> {
    pub(crate) network: &'a Network<R>,
    pub(crate) x: &'a [R::Vec3],
    pub(crate) f: &'a mut [R],
    pub(crate) gradient: &'a mut [R::Vec3],
}

impl<R: Lane> Pass for ValueGradient<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let network = self.network;
        let (mut scratch, mut few) = (None, None);
        let mut jets = Jets::new(&network.splines, true, false);
        let outputs = self.f.chunks_mut(LANES).zip(self.gradient.chunks_mut(LANES));
        for (x, (f, gradient)) in self.x.chunks(LANES).zip(outputs) {
            let count = block_points(x.len());
            let (x, few_x) = x.split_at(count);
            let ((f, few_f), (gradient, few_gradient)) =
                (f.split_at_mut(count), gradient.split_at_mut(count));
            if !few_x.is_empty() {
                let few = few.get_or_insert_with(|| FewPoints::new(network, true));
                few.gradients::<I>(network, few_x, &mut jets, few_f, few_gradient);
            }
            if x.is_empty() {
                continue;
            }
            let s = scratch.get_or_insert_with(|| network.mlp.scratch(true, false, false));
            if x.len() <= HALF {
                network.block_gradient::<I, HALF>(x, (s, &mut jets), f, gradient);
            } else {
                network.block_gradient::<I, LANES>(x, (s, &mut jets), f, gradient);
            }
        }
    }
}

/// The pass of [`Field::hessian_vector`].
pub(crate) struct HessianVector<'a, R: Real> {
    pub(crate) network: &'a Network<R>,
    pub(crate) x: &'a [R::Vec3],
    pub(crate) p: &'a [R::Vec3],
    pub(crate) gradient: &'a mut [R::Vec3],
    pub(crate) product: &'a mut [R::Vec3],
}

impl<R: Lane> Pass for HessianVector<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let encoder = &self.network.encoder;
        let mut s = self.network.mlp.scratch(true, true, false);
        let mut jets = Jets::new(&self.network.splines, true, true);
        let first = self.network.first_of_grid();
        let outputs = self.gradient.chunks_mut(LANES).zip(self.product.chunks_mut(LANES));
        for ((x, p), (gradient, product)) in
            self.x.chunks(LANES).zip(self.p.chunks(LANES)).zip(outputs)
        {
            if x.len() <= HALF {
                self.network.block_tangent::<I, HALF, false>(x, p, &[], (&mut s, &mut jets));
            } else {
                self.network.block_tangent::<I, LANES, false>(x, p, &[], (&mut s, &mut jets));
            }
            // The adjoints of the outputs already include the output factor, so it is 1 here.
            let mut g = encoder.encode_vjp::<I>(&s.features[0], &s.adjoint[1], R::one());
            let mut h = encoder.encode_vjp::<I>(&s.features[0], &s.adjoint[0], R::one());
            let [features, tangent] = &s.features;
            encoder.add_vjp_of_jvp::<I>(features, tangent, &s.adjoint[1], R::one(), &mut h);
            let scale = encoder.inverse_radius();
            jets.add_vjp::<I>(&s.adjoint[1][first..], scale, &mut g);
            jets.add_vjp::<I>(&s.adjoint[0][first..], scale, &mut h);
            jets.add_vjp_of_jvp::<I>(&s.adjoint[1][first..], scale, &mut h);
            for (l, (gradient, product)) in gradient.iter_mut().zip(product).enumerate() {
                *gradient = lane(&g, l);
                *product = lane(&h, l);
            }
        }
    }
}

/// The pass of [`Field::parameter_vjp`].
pub(crate) struct ParameterVjp<'a, R: Real> {
    pub(crate) network: &'a Network<R>,
    pub(crate) x: &'a [R::Vec3],
    pub(crate) alpha: &'a [R],
    pub(crate) c: &'a [R::Vec3],
    pub(crate) weights: &'a mut [R],
    /// The sums of the free coefficients of the grid.
    pub(crate) table: TableSum<'a, R>,
}

impl<R: Lane> Pass for ParameterVjp<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(mut self) {
        let network = self.network;
        let mut s = network.mlp.scratch(true, true, true);
        let mut jets = Jets::new(&network.splines, true, false);
        let coefficients = self.alpha.chunks(LANES).zip(self.c.chunks(LANES));
        for (x, (alpha, c)) in self.x.chunks(LANES).zip(coefficients) {
            network.block_tangent::<I, LANES, true>(x, c, alpha, (&mut s, &mut jets));
            grid::add_coefficients(
                &network.splines,
                network.first_of_grid(),
                x.len(),
                &s.features,
                &s.adjoint,
                &mut self.table,
            );
        }
        network.mlp.collect_gradient(&s, self.weights);
    }
}
