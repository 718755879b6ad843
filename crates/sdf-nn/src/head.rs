//! The radiance head: what leaves a surface point towards the camera.

use field::{Real, SurfaceAdjoint, SurfaceBatch, Vector3};

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

    /// Linear RGB at every point of a batch.
    pub fn radiance(&self, points: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]) {
        dispatch(Radiance { head: self, points: *points, rgb });
    }

    /// VJP of (x, n, d; parameters) ↦ RGB: overwrites `bars` (for x, per world unit), adds to
    /// `parameters`.
    ///
    /// # Panics
    /// If `parameters` has not one element a parameter.
    pub fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        adjoint: &[R::Vec3],
        bars: &mut SurfaceAdjoint<R>,
        parameters: &mut [R],
    ) {
        assert_eq!(parameters.len(), self.mlp.parameters.len(), "parameters");
        dispatch(Vjp { head: self, points: *points, adjoint, bars, parameters });
    }

    #[inline(always)]
    fn inputs<I: Isa>(&self, points: SurfaceBatch<'_, R>, features: &mut [Row<R>]) {
        let SurfaceBatch { x, normal, direction } = points;
        self.encoder.encode::<I>(x, features);
        let start = self.encoding.features();
        for l in 0..LANES {
            let at = l.min(x.len() - 1);
            let (n, d) = (normal[at].to_array(), direction[at].to_array());
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
    points: SurfaceBatch<'a, R>,
    rgb: &'a mut [R::Vec3],
}

impl<R: Lane> Pass for Radiance<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let mut s = self.head.mlp.scratch(false, false, false);
        let count = self.points.len();
        for (first, rgb) in (0..count).step_by(LANES).zip(self.rgb.chunks_mut(LANES)) {
            let block = self.points.range(first..(first + LANES).min(count));
            self.head.inputs::<I>(block, &mut s.features[0]);
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
    points: SurfaceBatch<'a, R>,
    adjoint: &'a [R::Vec3],
    bars: &'a mut SurfaceAdjoint<R>,
    parameters: &'a mut [R],
}

impl<R: Lane> Pass for Vjp<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let (mlp, start) = (&self.head.mlp, self.head.encoding.features());
        let mut s = mlp.scratch(true, false, true);
        for first in (0..self.points.len()).step_by(LANES) {
            let block = first..(first + LANES).min(self.points.len());
            self.head.inputs::<I>(self.points.range(block.clone()), &mut s.features[0]);
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
                self.bars.x[i] = lane(&x_rows, l);
                self.bars.normal[i] = lane(&n_rows, l);
                self.bars.direction[i] = lane(&d_rows, l);
            }
        }
        mlp.collect_gradient(&s, self.parameters);
    }
}
