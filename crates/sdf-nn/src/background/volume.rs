//! A volume behind the bounding sphere.

use std::fmt;

use field::{Real, Sphere};
use glam::DVec3;
use random::{Name, Stream};

use crate::background::decoder::{DENSITY_BIAS, LENGTH, initial_range};
use crate::background::grid::table_length;

/// The part of space that a background shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// Everything behind the bounding sphere.
    Volume,
    /// The directions alone: everything is infinitely far away.
    Direction,
}

impl fmt::Display for Extent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Extent::Volume => "volume",
            Extent::Direction => "direction",
        })
    }
}

/// The radiance of emitting and absorbing matter outside a bounding sphere.
///
/// Density and radiance are a small network of features on grids in contracted space. A ray is a
/// sum over 16 points from the place on where it leaves the sphere. The last point is opaque.
///
/// A ray that misses the sphere at the distance d from its centre, in bounding radii, begins
/// √(d² − 1) before it passes the centre. Nothing is before that: matter there could paint each
/// photograph on a screen of its own in front of its camera, and no solid would be needed. With 16
/// more points before the sphere, a fit of a cow in a room lost the cow's head and legs to such
/// screens.
///
/// Trainable features on grids of several resolutions: Müller, Evans, Schied and Keller, "Instant
/// Neural Graphics Primitives with a Multiresolution Hash Encoding", SIGGRAPH 2022. A model of its
/// own for the outside of a sphere: Zhang, Riegler, Snavely and Koltun, "NeRF++: Analyzing and
/// Improving Neural Radiance Fields", 2020.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume<R: Real> {
    pub(crate) extent: Extent,
    pub(crate) sphere: Sphere<f64>,
    pub(crate) parameters: Vec<R>,
}

/// The largest random feature at the start.
const FIRST_FEATURES: f64 = 0.01;

/// The bias of the density at the start: a density of 0.31 per bounding radius, so that far points
/// have a part in all rays.
const FIRST_DENSITY: f64 = -1.0;

/// The name of the parameters of a new volume in a stream. A fit also gives this name to the stream
/// of its volume.
pub const INITIAL_VOLUME: Name = Name::new("parameters of a new volume", 24);

impl<R: Real> Volume<R> {
    /// The number of parameters.
    pub const PARAMETERS: usize = table_length() + LENGTH;

    /// A volume of random features around a sphere, in world units. The same stream gives the same
    /// volume.
    pub fn new(extent: Extent, sphere: Sphere<f64>, stream: Stream) -> Self {
        let stream = stream.named(INITIAL_VOLUME);
        let tables = table_length();
        let number = |i: usize| {
            let range = i.checked_sub(tables).map_or(FIRST_FEATURES, initial_range);
            R::of(range * (2.0 * stream.at(i as u64).unit() - 1.0))
        };
        let mut parameters: Vec<R> = (0..Self::PARAMETERS).map(number).collect();
        parameters[tables + DENSITY_BIAS] = R::of(FIRST_DENSITY);
        Volume { extent, sphere, parameters }
    }

    /// The parameters: the tables of features, level by level, then the network.
    pub fn parameters(&self) -> &[R] {
        &self.parameters
    }

    /// Sets all parameters.
    ///
    /// # Panics
    /// If `parameters` has another length than [`parameters`](Self::parameters).
    pub fn set_parameters(&mut self, parameters: &[R]) {
        self.parameters.copy_from_slice(parameters);
    }

    /// The part of space that it shows.
    pub fn extent(&self) -> Extent {
        self.extent
    }

    /// The same volume around another sphere, in world units.
    #[must_use]
    pub fn around(self, sphere: Sphere<f64>) -> Self {
        Volume { sphere, ..self }
    }

    /// The same volume for points relative to `origin`, a point in world units.
    #[must_use]
    pub fn about(mut self, origin: DVec3) -> Self {
        self.sphere.center -= origin;
        self
    }
}
