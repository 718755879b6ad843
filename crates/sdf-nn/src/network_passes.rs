//! The passes of a network over a batch of points, block by block.

use field::{Real, TableSum};
use lanes::{GROUP, HALF, Isa, LANES, Lane, Pass};

use crate::encode::lane;
use crate::few_points::{FewPoints, block_points};
use crate::mlp::Scratch;
use crate::network::Network;
use crate::spline_block::{self, Jets};

/// The pass of [`Field::value`](field::Field::value).
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
                let few = few.get_or_insert_with(|| FewPoints::of(network, false));
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

/// The pass of [`Field::value_gradient`](field::Field::value_gradient).
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
                let few = few.get_or_insert_with(|| FewPoints::of(network, true));
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

/// The pass of [`Field::hessian_vector`](field::Field::hessian_vector).
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
        let HessianVector { network, mut x, mut p, mut gradient, mut product } = self;
        let mut s = network.mlp.scratch(true, true, false);
        let mut jets = Jets::new(&network.splines, true, true);
        while !x.is_empty() {
            let count = tangent_points(x.len());
            let (first_x, first_p) = (x.split_off(..count), p.split_off(..count));
            let (Some(x), Some(p)) = (first_x, first_p) else { return };
            let work = (&mut *s, &mut jets);
            if count <= GROUP {
                network.block_tangent::<I, GROUP, false>(x, p, &[], work);
            } else if count <= HALF {
                network.block_tangent::<I, HALF, false>(x, p, &[], work);
            } else {
                network.block_tangent::<I, LANES, false>(x, p, &[], work);
            }
            let outputs = (gradient.split_off_mut(..count), product.split_off_mut(..count));
            let (Some(gradient), Some(product)) = outputs else { return };
            write_products::<R, I>(network, (&s, &jets), gradient, product);
        }
    }
}

/// The points of the next block of a Hessian product, of `count` points that are left: as many as a
/// block has lanes, or fewer if half a block and a group after it take less time.
fn tangent_points(count: usize) -> usize {
    if (HALF..=HALF + GROUP).contains(&count) { HALF } else { count.min(LANES) }
}

/// Writes the gradients and products in the first lanes after the sweeps of a block.
#[inline(always)]
fn write_products<R: Lane, I: Isa>(
    network: &Network<R>,
    (s, jets): (&Scratch<R>, &Jets<R>),
    gradient: &mut [R::Vec3],
    product: &mut [R::Vec3],
) {
    let (encoder, first) = (&network.encoder, network.first_of_grid());
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

/// The pass of [`Field::parameter_vjp`](field::Field::parameter_vjp).
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
            I::call(spline_block::Coefficients {
                splines: &network.splines,
                first: network.first_of_grid(),
                count: x.len(),
                features: &s.features,
                adjoint: &s.adjoint,
                sums: &mut self.table,
            });
        }
        network.mlp.collect_gradient(&s, self.weights);
    }
}
