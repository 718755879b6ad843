//! A volume behind the bounding sphere.

use std::fmt;

use field::{Real, Sphere, Vector3};
use glam::DVec3;
use random::{Purpose, Stream};
use render::{Background, BackgroundRay};

use crate::decoder::{DENSITY_BIAS, Decoded, DecodedAdjoint, LENGTH, initial_range};
use crate::grid::{Cells, table_length};
use crate::path::{POINTS, Path, contract, contract_vjp};

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
/// sum over 16 points from the place on where it leaves the sphere, or passes it. The last point is
/// opaque. Nothing is before the sphere: matter there could paint each photograph on a screen of
/// its own in front of its camera, and no solid would be needed. With 16 more points before the
/// sphere, a fit of a cow in a room lost the cow's head and legs to such screens.
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

/// The transmittance below which the rest of a ray is not evaluated.
const OPAQUE: f64 = 1e-4;

/// A point of a ray, with the numbers that its reverse mode needs.
struct Seen<R: Real> {
    step: usize,
    y: R::Vec3,
    length: R,
    cells: Cells<R>,
    decoded: Decoded<R>,
    radiance: R::Vec3,
    /// The transmittance before and behind the point.
    transmittance: [R; 2],
}

impl<R: Real> Volume<R> {
    /// The number of parameters.
    pub const PARAMETERS: usize = table_length() + LENGTH;

    /// A volume of random features around a sphere, in world units. The same seed gives the same
    /// volume.
    pub fn new(extent: Extent, sphere: Sphere<f64>, seed: u64) -> Self {
        let stream = Stream::new(seed, Purpose::InitialBackground);
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

    /// The ray relative to the sphere, and the numbers of its first steps.
    fn path(&self, ray: &BackgroundRay<R>) -> (Path<R>, std::ops::Range<usize>) {
        let Sphere { center, radius } = self.sphere;
        let origin = (ray.origin - R::Vec3::of(center)) * R::of(radius).recip();
        let first = if self.extent == Extent::Volume { 0 } else { POINTS - 1 };
        (Path::new(origin, ray.direction), first..POINTS)
    }

    /// The points of a ray with a part in its radiance, in order.
    fn points(
        &self,
        path: &Path<R>,
        steps: std::ops::Range<usize>,
        mut visit: impl FnMut(Seen<R>),
    ) {
        let (tables, decoder) = self.parameters.split_at(table_length());
        let mut before = R::one();
        for step in steps {
            let (y, length) = self.point(path, step);
            if length <= R::zero() || before < R::of(OPAQUE) {
                continue;
            }
            let cells = Cells::of(contract::<R>(y));
            let decoded = Decoded::of(cells.features(tables), decoder);
            let (density, radiance) = (decoded.density(), decoded.radiance());
            // The last point is opaque.
            let behind =
                if length.is_finite() { before * (-density * length).exp() } else { R::zero() };
            let transmittance = [before, behind];
            visit(Seen { step, y, length, cells, decoded, radiance, transmittance });
            before = behind;
        }
    }

    /// The point of a step, and the length of the step.
    fn point(&self, path: &Path<R>, step: usize) -> (R::Vec3, R) {
        match self.extent {
            Extent::Volume => {
                let step = path.step(step);
                (step.y, step.length)
            }
            Extent::Direction => (path.infinity(), R::infinity()),
        }
    }

    /// Goes back along all rays whose adjoint δ is not zero. Visits each of their points with the
    /// number and the path of the ray, and the adjoints of the decoder.
    fn backward(
        &self,
        rays: &[BackgroundRay<R>],
        adjoint: &[R::Vec3],
        mut visit: impl FnMut(usize, &Path<R>, &Seen<R>, DecodedAdjoint<R>),
    ) {
        let decoder = &self.parameters[table_length()..];
        let mut seen = Vec::with_capacity(POINTS);
        for (i, (ray, delta)) in rays.iter().zip(adjoint).enumerate() {
            if *delta == R::Vec3::zero() {
                continue;
            }
            let (path, steps) = self.path(ray);
            self.points(&path, steps, |point| seen.push(point));
            // The radiance of the points behind.
            let mut behind = R::Vec3::zero();
            for point in seen.drain(..).rev() {
                let [before, after] = point.transmittance;
                // ∂L/∂(density · length)
                let depth = delta.dot(point.radiance * after - behind);
                behind += point.radiance * (before - after);
                let finite = point.length.is_finite();
                let density = if finite { depth * point.length } else { R::zero() };
                let radiance = *delta * (before - after);
                visit(i, &path, &point, point.decoded.vjp(density, radiance, decoder));
            }
        }
    }
}

impl<R: Real> Background<R> for Volume<R> {
    fn parameter_count(&self) -> usize {
        self.parameters.len()
    }

    fn radiance(&self, rays: &[BackgroundRay<R>], rgb: &mut [R::Vec3]) {
        for (ray, rgb) in rays.iter().zip(rgb) {
            let (path, steps) = self.path(ray);
            *rgb = R::Vec3::zero();
            self.points(&path, steps, |point| {
                let [before, after] = point.transmittance;
                *rgb += point.radiance * (before - after);
            });
        }
    }

    fn direction_vjp(
        &self,
        rays: &[BackgroundRay<R>],
        adjoint: &[R::Vec3],
        direction: &mut [R::Vec3],
    ) {
        let tables = &self.parameters[..table_length()];
        direction.fill(R::Vec3::zero());
        self.backward(rays, adjoint, |i, path, point, bars| {
            let y = contract_vjp::<R>(point.y, point.cells.point_vjp(&bars.features, tables));
            direction[i] += match self.extent {
                Extent::Volume => path.vjp(point.step, y),
                Extent::Direction => path.infinity_vjp(y),
            };
        });
    }

    fn parameter_vjp(&self, rays: &[BackgroundRay<R>], adjoint: &[R::Vec3], parameters: &mut [R]) {
        let (tables, decoder) = parameters.split_at_mut(table_length());
        self.backward(rays, adjoint, |_, _, point, bars| {
            point.decoded.parameter_vjp(&bars, decoder);
            point.cells.table_vjp(&bars.features, tables);
        });
    }
}
