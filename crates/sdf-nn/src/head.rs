//! The radiance head: the radiance from a surface point towards the camera.

use field::{Real, SurfaceAdjoint, SurfaceBatch, Vector3};
use glam::DVec3;

use crate::architecture::{Activation, Encoding, Transform};
use crate::encode::{Encoder, lane};
use crate::init::Random;
use crate::math::Lane;
use crate::mlp::Mlp;
use crate::simd::{Isa, LANES, Pass, Row, dispatch};

/// A network from a surface point, its unit normal n and the view direction d to linear RGB.
///
/// Its inputs are the encoding of the position in the unit ball, then n, then d, as in Yariv et
/// al., “Multiview Neural Surface Reconstruction by Disentangling Geometry and Appearance”, NeurIPS
/// 2020, but without its feature vector.
///
/// Each output y becomes a radiance sigmoid(y)² in [0, 1]. The transfer function of a display is
/// close to a square root, so the displayed value is close to sigmoid(y): dark and bright parts are
/// equally easy to fit.
#[derive(Clone, Debug)]
pub struct RadianceHead<R: Real> {
    pub(crate) encoding: Encoding,
    pub(crate) transform: Transform,
    pub(crate) mlp: Mlp<R>,
    encoder: Encoder<R>,
}

/// The number of inputs after the encoded position: normal and direction.
pub(crate) const DIRECTIONS: usize = 6;

impl<R: Lane> RadianceHead<R> {
    /// The number of inputs after the encoded position: normal and direction.
    pub const DIRECTIONS: usize = DIRECTIONS;

    /// A head with random weights, small in the last layer: its first radiance is close to grey.
    ///
    /// The same `seed` gives the same head.
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

    /// A head whose parameters are all zero.
    pub(crate) fn zero(
        encoding: Encoding,
        hidden: &[usize],
        activation: Activation,
        transform: Transform,
    ) -> Self {
        let mlp = Mlp::new(encoding.features() + DIRECTIONS, hidden, 3, &[], activation);
        RadianceHead { encoding, transform, mlp, encoder: Encoder::new(encoding, &transform) }
    }

    /// The same head for points relative to `origin`, a point in world units.
    #[must_use]
    pub fn about(mut self, origin: DVec3) -> Self {
        self.transform.center -= origin;
        self.encoder = Encoder::new(self.encoding, &self.transform);
        self
    }

    /// All parameters: layer after layer the weights (outputs × inputs, row-major), then the bias.
    pub fn parameters(&self) -> &[R] {
        &self.mlp.parameters
    }

    /// Sets all parameters.
    ///
    /// # Panics
    /// If `parameters` has another length than [`parameters`](Self::parameters).
    pub fn set_parameters(&mut self, parameters: &[R]) {
        self.mlp.parameters.copy_from_slice(parameters);
        self.mlp.repack();
    }

    /// Sets the weight, in [0, 1], of every octave of the position's encoding, as
    /// [`crate::Network::set_band_weights`], and that of the view direction. With a weight of 0,
    /// the radiance is the same in all directions.
    ///
    /// # Panics
    /// If `bands` does not have one element for each octave.
    pub fn set_input_weights(&mut self, bands: &[R], direction: R) {
        assert_eq!(bands.len(), self.encoding.bands(), "number of octave weights");
        let mut window = Encoder::window(bands);
        window.extend([R::one(); 3]);
        window.extend([direction; 3]);
        self.mlp.set_window(window);
    }

    /// Writes the radiance, in linear RGB, from every point of a batch towards the camera.
    pub fn radiance(&self, points: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]) {
        dispatch(Radiance { head: self, points: *points, rgb });
    }

    /// VJP of (x, n, d; θ) ↦ RGB to all of its inputs.
    ///
    /// `rgb_adjoint` has one element for each point. The adjoints of x, n and d replace the
    /// contents of `surface_adjoint`; that of θ is added to `parameter_adjoint`.
    ///
    /// # Panics
    /// If `parameter_adjoint` does not have the length of θ, or if `surface_adjoint` is shorter
    /// than the batch.
    pub fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        rgb_adjoint: &[R::Vec3],
        surface_adjoint: &mut SurfaceAdjoint<R>,
        parameter_adjoint: &mut [R],
    ) {
        assert_eq!(
            parameter_adjoint.len(),
            self.mlp.parameters.len(),
            "number of parameter adjoints"
        );
        let points = *points;
        dispatch(Vjp { head: self, points, rgb_adjoint, surface_adjoint, parameter_adjoint });
    }

    /// Writes the inputs of at most `LANES` points. Lanes without a point repeat the last point.
    #[inline(always)]
    fn write_inputs<I: Isa>(&self, points: SurfaceBatch<'_, R>, features: &mut [Row<R>]) {
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

/// sigmoid(y)² and its derivative.
#[inline(always)]
fn sigmoid_squared<R: Lane, I: Isa>(y: R) -> (R, R) {
    let e = R::exp_negative::<I>(y.abs());
    let high = R::one() / (R::one() + e);
    let s = if y > R::zero() { high } else { e * high } + y * R::zero();
    let complement = if y > R::zero() { e * high } else { high };
    (s * s, R::of(2.0) * s * s * complement)
}

/// The pass of [`RadianceHead::radiance`].
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
            self.head.write_inputs::<I>(block, &mut s.features[0]);
            self.head.mlp.forward::<I, LANES, false, false>(&mut s);
            for (l, rgb) in rgb.iter_mut().enumerate() {
                *rgb = R::Vec3::from_array(std::array::from_fn(|c| {
                    sigmoid_squared::<R, I>(s.output[0][c].0[l]).0
                }));
            }
        }
    }
}

/// The pass of [`RadianceHead::vjp`].
struct Vjp<'a, R: Real> {
    head: &'a RadianceHead<R>,
    points: SurfaceBatch<'a, R>,
    rgb_adjoint: &'a [R::Vec3],
    surface_adjoint: &'a mut SurfaceAdjoint<R>,
    parameter_adjoint: &'a mut [R],
}

impl<R: Lane> Pass for Vjp<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let (mlp, start) = (&self.head.mlp, self.head.encoding.features());
        let mut s = mlp.scratch(true, false, true);
        for first in (0..self.points.len()).step_by(LANES) {
            let block = first..(first + LANES).min(self.points.len());
            self.head.write_inputs::<I>(self.points.range(block.clone()), &mut s.features[0]);
            mlp.forward::<I, LANES, true, false>(&mut s);
            for l in 0..LANES {
                let adjoint =
                    self.rgb_adjoint[block.clone()].get(l).map_or([R::zero(); 3], |a| a.to_array());
                for c in 0..3 {
                    s.output[0][c].0[l] =
                        adjoint[c] * sigmoid_squared::<R, I>(s.output[0][c].0[l]).1;
                }
            }
            mlp.backward::<I, LANES, false, true>(&mut s);
            let x_rows = self.head.encoder.encode_vjp::<I>(&s.features[0], &s.adjoint[0], R::one());
            let rows = |first: usize| {
                [s.adjoint[0][first], s.adjoint[0][first + 1], s.adjoint[0][first + 2]]
            };
            let (n_rows, d_rows) = (rows(start), rows(start + 3));
            for (l, i) in block.enumerate() {
                self.surface_adjoint.x[i] = lane(&x_rows, l);
                self.surface_adjoint.normal[i] = lane(&n_rows, l);
                self.surface_adjoint.direction[i] = lane(&d_rows, l);
            }
        }
        mlp.collect_gradient(&s, self.parameter_adjoint);
    }
}
