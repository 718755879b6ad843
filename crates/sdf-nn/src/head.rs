//! The radiance head: the radiance from a surface point towards the camera.

use std::ops::Range;

use crate::grids::HashGrid;
use field::{Real, SurfaceAdjoint, SurfaceBatch, TableSum, Vector3};
use glam::DVec3;
use random::Stream;

use crate::architecture::{Activation, Encoding, Transform};
use crate::encode::{Encoder, lane};
use crate::init::Random;
use crate::mlp::Mlp;
use lanes::{Isa, LANES, Lane, Pass, Row};

/// A network from a surface point, its unit normal n and the view direction d to linear RGB.
///
/// Its inputs are the encoding of the position in the unit ball, then n, then d, as in Yariv et
/// al., “Multiview Neural Surface Reconstruction by Disentangling Geometry and Appearance”, NeurIPS
/// 2020, but without its feature vector. A head with details has features on grids as further
/// inputs; their adjoints by the position jump between cells.
///
/// Each output y becomes a radiance sigmoid(y)² in [0, 1]. The transfer function of a display is
/// close to a square root, so the displayed value is close to sigmoid(y): dark and bright parts are
/// equally easy to fit.
#[derive(Clone, Debug)]
pub struct RadianceHead<R: Real> {
    pub(crate) encoding: Encoding,
    pub(crate) transform: Transform,
    pub(crate) mlp: Mlp<R>,
    pub(crate) details: HashGrid,
    /// The features at the corners of the grids, level by level.
    pub(crate) tables: Vec<R>,
    encoder: Encoder<R>,
}

/// The number of inputs after the encoded position: normal and direction. The features of details
/// come after these.
pub(crate) const DIRECTIONS: usize = 6;

/// The largest random feature of a grid at the start.
const FIRST_FEATURES: f64 = 0.01;

impl<R: Lane> RadianceHead<R> {
    /// The number of inputs after the encoded position: normal and direction.
    pub const DIRECTIONS: usize = DIRECTIONS;

    /// A head with random weights, small in the last layer: its first radiance is close to grey.
    ///
    /// `details` has the number of cells along the side of each grid; none for a head of octaves.
    ///
    /// The same `stream` gives the same head.
    pub fn new(
        encoding: Encoding,
        details: &[usize],
        hidden: Vec<usize>,
        activation: Activation,
        transform: Transform,
        stream: Stream,
    ) -> Self {
        let mut head = Self::zero(encoding, details, &hidden, activation, transform);
        let mut random = Random::new(stream);
        crate::init::variance_preserving(&mut head.mlp, &mut random);
        head.tables.fill_with(|| R::of(FIRST_FEATURES * (2.0 * random.uniform() - 1.0)));
        head.mlp.repack();
        head
    }

    /// A head whose parameters are all zero.
    pub(crate) fn zero(
        encoding: Encoding,
        details: &[usize],
        hidden: &[usize],
        activation: Activation,
        transform: Transform,
    ) -> Self {
        let details = HashGrid::new(details);
        let inputs = encoding.features() + DIRECTIONS + details.features();
        let mlp = Mlp::new(inputs, hidden, 3, &[], activation, false);
        let (tables, encoder) =
            (vec![R::zero(); details.table_length()], Encoder::new(encoding, &transform));
        RadianceHead { encoding, transform, mlp, details, tables, encoder }
    }

    /// The same head for points relative to `origin`, a point in world units.
    #[must_use]
    pub fn about(mut self, origin: DVec3) -> Self {
        self.transform = self.transform.about(origin);
        self.encoder = Encoder::new(self.encoding, &self.transform);
        self
    }

    /// All parameters: layer after layer the weights (outputs × inputs, row-major), then the bias;
    /// then the features of details, level by level.
    pub fn parameters(&self) -> Vec<R> {
        [&self.mlp.parameters[..], &self.tables].concat()
    }

    /// The number of inputs and the number of parameters of details with these numbers of cells.
    pub fn size_of_details(cells: &[usize]) -> (usize, usize) {
        let details = HashGrid::new(cells);
        (details.features(), details.table_length())
    }

    /// The number of parameters.
    pub fn parameter_count(&self) -> usize {
        self.mlp.parameters.len() + self.tables.len()
    }

    /// The weight matrices of layer after layer: the place of each among the parameters, row-major,
    /// and its number of columns.
    pub fn matrices(&self) -> impl Iterator<Item = (Range<usize>, usize)> + '_ {
        self.mlp.matrices()
    }

    /// The number of features of details: the last parameters.
    pub fn detail_count(&self) -> usize {
        self.tables.len()
    }

    /// Sets all parameters.
    ///
    /// # Panics
    /// If `parameters` has another length than [`parameters`](Self::parameters).
    pub fn set_parameters(&mut self, parameters: &[R]) {
        let (weights, tables) = parameters.split_at(self.mlp.parameters.len());
        self.mlp.parameters.copy_from_slice(weights);
        self.tables.copy_from_slice(tables);
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
        window.resize(self.mlp.features, R::one());
        self.mlp.set_window(window);
    }
}

impl<R: Lane> RadianceHead<R> {
    /// Writes the inputs of at most `LANES` points. Lanes without a point repeat the last point.
    #[inline(always)]
    fn write_inputs<I: Isa>(&self, points: SurfaceBatch<'_, R>, features: &mut [Row<R>]) {
        let SurfaceBatch { x, normal, direction } = points;
        self.encoder.encode::<I, LANES>(x, features);
        let start = self.encoding.features();
        let (others, details) = features.split_at_mut(start + DIRECTIONS);
        if self.details.features() > 0 {
            for l in 0..LANES {
                let put = |i: usize, value| details[i].0[l] = value;
                self.details.encode(&self.tables, unit_position(others, l), put);
            }
        }
        for l in 0..LANES {
            let at = l.min(x.len() - 1);
            let (n, d) = (normal[at].to_array(), direction[at].to_array());
            for c in 0..3 {
                others[start + c].0[l] = n[c];
                others[start + 3 + c].0[l] = d[c];
            }
        }
    }
}

/// The position of lane `l` in the unit ball: the first three features.
#[inline(always)]
fn unit_position<R: Real>(features: &[Row<R>], l: usize) -> [R; 3] {
    std::array::from_fn(|c| features[c].0[l])
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

/// The pass of [`Shader::radiance`](field::Shader::radiance).
pub(crate) struct Radiance<'a, R: Real> {
    pub(crate) head: &'a RadianceHead<R>,
    pub(crate) points: SurfaceBatch<'a, R>,
    pub(crate) rgb: &'a mut [R::Vec3],
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

/// The pass of [`Shader::vjp`](field::Shader::vjp).
pub(crate) struct Vjp<'a, R: Real> {
    pub(crate) head: &'a RadianceHead<R>,
    pub(crate) points: SurfaceBatch<'a, R>,
    pub(crate) rgb_adjoint: &'a [R::Vec3],
    pub(crate) surface_adjoint: &'a mut SurfaceAdjoint<R>,
    pub(crate) weights: &'a mut [R],
    /// The sums of the features of details.
    pub(crate) tables: TableSum<'a, R>,
}

impl<R: Lane> Pass for Vjp<'_, R> {
    #[inline(always)]
    fn run<I: Isa>(mut self) {
        let (mlp, start) = (&self.head.mlp, self.head.encoding.features());
        let details = &self.head.details;
        let inverse_radius = R::of(self.head.transform.radius.recip());
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
                let mut x = lane(&x_rows, l);
                if details.features() > 0 {
                    let y = unit_position(&s.features[0], l);
                    let adjoint = |f: usize| s.adjoint[0][start + DIRECTIONS + f].0[l];
                    let bar = details.encode_vjp(&self.head.tables, y, adjoint, &mut self.tables);
                    x += R::Vec3::from_array(bar) * inverse_radius;
                }
                self.surface_adjoint.x[i] = x;
                self.surface_adjoint.normal[i] = lane(&n_rows, l);
                self.surface_adjoint.direction[i] = lane(&d_rows, l);
            }
        }
        mlp.collect_gradient(&s, self.weights);
    }
}
