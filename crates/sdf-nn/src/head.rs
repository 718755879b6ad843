//! The radiance head: what leaves a surface point towards the camera.

use field::{Real, Vector3};

use crate::architecture::{Activation, Encoding, Transform};
use crate::encode::{Encoder, lane};
use crate::init::Random;
use crate::kernel::{LANES, Row};
use crate::math::Lane;
use crate::mlp::Mlp;
use crate::simd::{Isa, Pass, dispatch};

/// A network from a point, its unit normal and the view direction to linear RGB.
///
/// Its inputs are the frequency encoding of the position in the unit ball, then n, then d. Each
/// output y becomes a radiance sigmoid(y)², in [0, 1]: with a display's transfer function on top
/// that is close to sigmoid(y) again, so that dark and bright parts are fitted with like effort.
#[derive(Clone, Debug)]
pub struct RadianceHead<R: Real> {
    pub(crate) encoding: Encoding,
    pub(crate) transform: Transform,
    pub(crate) mlp: Mlp<R>,
    encoder: Encoder<R>,
}

/// Inputs beside the encoded position: normal and direction.
pub(crate) const DIRECTIONS: usize = 6;

impl<R: Lane> RadianceHead<R> {
    /// A head with random hidden layers and a small last one: grey to begin with.
    pub fn new(
        encoding: Encoding,
        hidden: Vec<usize>,
        activation: Activation,
        transform: Transform,
        seed: u64,
    ) -> Self {
        let mut head = Self::zero(encoding, &hidden, activation, transform);
        crate::init::variance_preserving(&mut head.mlp, &mut Random::new(seed));
        head.mlp.repack();
        head
    }

    pub(crate) fn zero(
        encoding: Encoding,
        hidden: &[usize],
        activation: Activation,
        transform: Transform,
    ) -> Self {
        let mlp = Mlp::new(encoding.features() + DIRECTIONS, hidden, 3, &[], activation);
        RadianceHead { encoding, transform, mlp, encoder: Encoder::new(encoding, &transform) }
    }

    /// All parameters: layer after layer the weights (outputs × inputs, row-major), then the bias.
    pub fn parameters(&self) -> &[R] {
        &self.mlp.parameters
    }

    /// Sets all parameters.
    ///
    /// # Panics
    /// If their number is not that of the network.
    pub fn set_parameters(&mut self, parameters: &[R]) {
        self.mlp.parameters.copy_from_slice(parameters);
        self.mlp.repack();
    }

    /// Sets a weight in [0, 1] on every octave of the position's encoding; see
    /// [`crate::Network::set_band_weights`].
    ///
    /// # Panics
    /// If their number is not that of the encoding's octaves.
    pub fn set_band_weights(&mut self, weights: &[R]) {
        assert_eq!(weights.len(), self.encoding.bands(), "weights of octaves");
        let mut window = Encoder::window(weights);
        window.extend([R::one(); DIRECTIONS]);
        self.mlp.set_window(window);
    }

    /// Linear RGB at points `x` with unit normals `n`, seen along unit directions `d`.
    pub fn radiance(&self, x: &[R::Vec3], n: &[R::Vec3], d: &[R::Vec3], rgb: &mut [R::Vec3]) {
        dispatch(Radiance { head: self, x, n, d, rgb });
    }

    /// VJP of (x, n, d; parameters) ↦ RGB: overwrites the adjoints of x (per world unit), n and d,
    /// adds to `parameters`.
    #[allow(
        clippy::too_many_arguments,
        reason = "three inputs, one output, and an adjoint for each"
    )]
    pub fn vjp(
        &self,
        x: &[R::Vec3],
        n: &[R::Vec3],
        d: &[R::Vec3],
        adjoint: &[R::Vec3],
        x_bar: &mut [R::Vec3],
        n_bar: &mut [R::Vec3],
        d_bar: &mut [R::Vec3],
        parameters: &mut [R],
    ) {
        assert_eq!(parameters.len(), self.mlp.parameters.len(), "parameters");
        dispatch(Vjp {
            head: self,
            inputs: [x, n, d],
            adjoint,
            bars: [x_bar, n_bar, d_bar],
            parameters,
        });
    }

    #[inline(always)]
    fn inputs<I: Isa>(&self, x: &[R::Vec3], n: &[R::Vec3], d: &[R::Vec3], features: &mut [Row<R>]) {
        self.encoder.encode::<I>(x, features);
        let start = self.encoding.features();
        for l in 0..LANES {
            let at = l.min(x.len() - 1);
            let (n, d) = (n[at].to_array(), d[at].to_array());
            for c in 0..3 {
                features[start + c].0[l] = n[c];
                features[start + 3 + c].0[l] = d[c];
            }
        }
    }
}

/// sigmoid(y)² and its slope.
#[inline(always)]
fn squash<R: Lane, I: Isa>(y: R) -> (R, R) {
    let e = R::exp_negative::<I>(y.abs());
    let high = R::one() / (R::one() + e);
    let s = if y > R::zero() { high } else { e * high } + y * R::zero();
    let complement = if y > R::zero() { e * high } else { high };
    (s * s, R::of(2.0) * s * s * complement)
}

struct Radiance<'a, R: Real> {
    head: &'a RadianceHead<R>,
    x: &'a [R::Vec3],
    n: &'a [R::Vec3],
    d: &'a [R::Vec3],
    rgb: &'a mut [R::Vec3],
}

impl<R: Lane> Pass for Radiance<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let mut s = self.head.mlp.scratch(false, false, false);
        let chunks = self.x.chunks(LANES).zip(self.n.chunks(LANES)).zip(self.d.chunks(LANES));
        for (((x, n), d), rgb) in chunks.zip(self.rgb.chunks_mut(LANES)) {
            self.head.inputs::<I>(x, n, d, &mut s.features[0]);
            self.head.mlp.forward::<I, LANES, false, false>(&mut s);
            for (l, rgb) in rgb.iter_mut().enumerate() {
                *rgb = R::Vec3::from_array(std::array::from_fn(|c| {
                    squash::<R, I>(s.output[0][c].0[l]).0
                }));
            }
        }
    }
}

struct Vjp<'a, R: Real> {
    head: &'a RadianceHead<R>,
    inputs: [&'a [R::Vec3]; 3],
    adjoint: &'a [R::Vec3],
    bars: [&'a mut [R::Vec3]; 3],
    parameters: &'a mut [R],
}

impl<R: Lane> Pass for Vjp<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let [x, n, d] = self.inputs;
        let [x_bar, n_bar, d_bar] = self.bars;
        let (mlp, start) = (&self.head.mlp, self.head.encoding.features());
        let mut s = mlp.scratch(true, false, true);
        for first in (0..x.len()).step_by(LANES) {
            let block = first..(first + LANES).min(x.len());
            self.head.inputs::<I>(
                &x[block.clone()],
                &n[block.clone()],
                &d[block.clone()],
                &mut s.features[0],
            );
            mlp.forward::<I, LANES, true, false>(&mut s);
            for l in 0..LANES {
                let adjoint =
                    self.adjoint[block.clone()].get(l).map_or([R::zero(); 3], |a| a.to_array());
                for c in 0..3 {
                    s.output[0][c].0[l] = adjoint[c] * squash::<R, I>(s.output[0][c].0[l]).1;
                }
            }
            mlp.backward::<I, LANES, false, true>(&mut s);
            let x_rows = self.head.encoder.pull_back::<I>(&s.features[0], &s.adjoint[0], R::one());
            let rows = |at: usize| [s.adjoint[0][at], s.adjoint[0][at + 1], s.adjoint[0][at + 2]];
            let (n_rows, d_rows) = (rows(start), rows(start + 3));
            for (l, i) in block.enumerate() {
                x_bar[i] = lane(&x_rows, l);
                n_bar[i] = lane(&n_rows, l);
                d_bar[i] = lane(&d_rows, l);
            }
        }
        mlp.collect_gradient(&s, self.parameters);
    }
}
