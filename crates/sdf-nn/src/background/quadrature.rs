//! Sums along rays through a volume, and their derivatives.

use std::ops::Range;

use field::{Background, BackgroundRay, RayAdjoint};
use field::{PartialSum, Real, Sphere, TableSum, Vector3};
use random::Stream;

use crate::background::decoder::{Decoded, DecodedAdjoint};
use crate::background::grid::{Cells, table_length};
use crate::background::path::{POINTS, Path, contract, contract_vjp};
use crate::background::volume::{Extent, Volume};

/// A volume with the places of the points on its rays.
#[derive(Clone, Copy, Debug)]
pub struct Quadrature<'a, R: Real> {
    pub(crate) volume: &'a Volume<R>,
    pub(crate) places: Places,
}

/// The places of the points in the parts of a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Places {
    /// This fraction of each part.
    At(f64),
    /// A random fraction for each ray.
    Random(Stream),
}

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

impl<R: Real> Quadrature<'_, R> {
    /// The ray relative to the sphere, and the numbers of its first steps.
    fn path(&self, ray: &BackgroundRay<R>) -> (Path<R>, Range<usize>) {
        let Sphere { center, radius } = self.volume.sphere;
        let origin = (ray.origin - R::Vec3::of(center)) * R::of(radius).recip();
        let first = if self.volume.extent == Extent::Volume { 0 } else { POINTS - 1 };
        (Path::new(origin, ray.direction, self.place(ray)), first..POINTS)
    }

    /// The place of a ray's points in their parts, as a fraction.
    fn place(&self, ray: &BackgroundRay<R>) -> R {
        R::of(match self.places {
            Places::At(place) => place,
            Places::Random(stream) => {
                let [x, y, z] = ray.direction.to_double().to_array().map(f64::to_bits);
                stream.at(x).at(y).at(z).unit()
            }
        })
    }

    /// The points of a ray with a part in its radiance, in order.
    fn points(&self, path: &Path<R>, steps: Range<usize>, mut visit: impl FnMut(Seen<R>)) {
        let (tables, decoder) = self.volume.parameters.split_at(table_length());
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
        match self.volume.extent {
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
        let decoder = &self.volume.parameters[table_length()..];
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

impl<R: Real> Background<R> for Quadrature<'_, R> {
    fn parameter_count(&self) -> usize {
        self.volume.parameters.len()
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

    fn ray_vjp(&self, rays: &[BackgroundRay<R>], adjoint: &[R::Vec3], bars: &mut [RayAdjoint<R>]) {
        let tables = &self.volume.parameters[..table_length()];
        let scale = R::of(self.volume.sphere.radius).recip();
        bars.fill(RayAdjoint::zero());
        self.backward(rays, adjoint, |i, path, point, decoded| {
            let y = contract_vjp::<R>(point.y, point.cells.point_vjp(&decoded.features, tables));
            let RayAdjoint { origin, direction } = match self.volume.extent {
                Extent::Volume => path.vjp(point.step, y),
                Extent::Direction => path.infinity_vjp(y),
            };
            bars[i].origin += origin * scale;
            bars[i].direction += direction;
        });
    }

    fn parameter_vjp(&self, rays: &[BackgroundRay<R>], adjoint: &[R::Vec3], parameters: &mut [R]) {
        let (tables, decoder) = parameters.split_at_mut(table_length());
        self.backward(rays, adjoint, |_, _, point, bars| {
            point.decoded.parameter_vjp(&bars, decoder);
            point.cells.table_vjp(&bars.features, &mut TableSum::Vector(tables));
        });
    }

    fn table(&self) -> Range<usize> {
        0..table_length()
    }

    fn add_parameter_vjp(
        &self,
        rays: &[BackgroundRay<R>],
        adjoint: &[R::Vec3],
        sum: &mut PartialSum<R>,
    ) {
        assert_eq!(sum.place(), self.table(), "place of the features");
        self.backward(rays, adjoint, |_, _, point, bars| {
            point.decoded.parameter_vjp(&bars, &mut sum.others);
            let mut table = TableSum::Additions(&mut sum.table);
            point.cells.table_vjp(&bars.features, &mut table);
        });
    }
}

impl<R: Real> Volume<R> {
    /// The volume for training: each ray has its points at random places of their parts.
    ///
    /// A place is a function of the stream and of the ray's direction, so that a ray has the same
    /// points in radiance and derivatives. Points in the middle of the parts would be the same in
    /// each iteration, and matter between them could not be trained away.
    pub fn jittered(&self, stream: Stream) -> Quadrature<'_, R> {
        Quadrature { volume: self, places: Places::Random(stream) }
    }

    fn with_middles(&self) -> Quadrature<'_, R> {
        Quadrature { volume: self, places: Places::At(0.5) }
    }
}

/// Points are in the middle of the parts of a ray.
impl<R: Real> Background<R> for Volume<R> {
    fn parameter_count(&self) -> usize {
        self.parameters.len()
    }

    fn radiance(&self, rays: &[BackgroundRay<R>], rgb: &mut [R::Vec3]) {
        self.with_middles().radiance(rays, rgb);
    }

    fn ray_vjp(&self, rays: &[BackgroundRay<R>], adjoint: &[R::Vec3], bars: &mut [RayAdjoint<R>]) {
        self.with_middles().ray_vjp(rays, adjoint, bars);
    }

    fn parameter_vjp(&self, rays: &[BackgroundRay<R>], adjoint: &[R::Vec3], parameters: &mut [R]) {
        self.with_middles().parameter_vjp(rays, adjoint, parameters);
    }

    fn table(&self) -> Range<usize> {
        self.with_middles().table()
    }

    fn add_parameter_vjp(
        &self,
        rays: &[BackgroundRay<R>],
        adjoint: &[R::Vec3],
        sum: &mut PartialSum<R>,
    ) {
        self.with_middles().add_parameter_vjp(rays, adjoint, sum);
    }
}
