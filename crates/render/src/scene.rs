//! A field, its appearance, and the cameras that look at it.

use std::fmt;

use field::{Background, BackgroundRay, Field, FilmPlace, Real, Shader, Sphere, Vector3};

use crate::camera::Camera;
use crate::sample::Sample;

/// A field, its appearance, and the cameras that look at it.
#[derive(Clone, Copy)]
pub struct Scene<'a, R: Real> {
    /// The signed distance f, in world units.
    pub field: &'a dyn Field<R>,
    /// The radiance at its surface.
    pub shader: &'a dyn Shader<R>,
    /// The cameras that samples refer to.
    pub cameras: &'a [Camera],
    /// The bounding sphere, in world units: it holds the solid, with room for a warp around it.
    pub bounds: Sphere<f64>,
    /// The radiance along rays without a hit.
    pub background: &'a dyn Background<R>,
    /// The tracer's options and the ball of rays.
    pub tracing: Tracing<R>,
    /// Values of the field, with which rays skip empty space.
    pub lattice: Option<&'a trace::Lattice<R>>,
    /// The largest clearance of a closest approach that matters, in pixels: with a lattice, rays
    /// leave out others.
    pub reach: f64,
}

impl<R: Real> fmt::Debug for Scene<'_, R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("Scene");
        shown.field("cameras", &self.cameras).field("bounds", &self.bounds);
        shown.field("tracing", &self.tracing).finish_non_exhaustive()
    }
}

/// The tracer's options, and the ball of rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracing<R: Real> {
    /// The tracer's options.
    pub options: trace::Options<R>,
    /// The ball of rays: rays start and end on it. In world units.
    pub ball: Sphere<R>,
}

/// The radius of the ball of rays that look for hits only, in radii of the field's own ball.
/// A ray must start outside the solid, and the solid may touch its own ball from inside.
const SOLID_MARGIN: f64 = 1.02;

/// Cap on the film width, in pixels, that sets the tracing scale: larger images resolve finer
/// detail.
const SCALE_PIXELS: f64 = 256.0;

impl<'a, R: Real> Scene<'a, R> {
    /// A scene with the default tracer, whose rays start and end on `bounds`.
    pub fn new(
        field: &'a dyn Field<R>,
        shader: &'a dyn Shader<R>,
        cameras: &'a [Camera],
        bounds: &Sphere<f64>,
        background: &'a dyn Background<R>,
    ) -> Self {
        let tracing = Tracing { options: trace::Options::default(), ball: in_precision(bounds) };
        Scene {
            field,
            shader,
            cameras,
            bounds: *bounds,
            background,
            tracing,
            lattice: None,
            reach: f64::INFINITY,
        }
    }

    /// The ray of a film sample, as the argument of the background.
    pub fn background_ray(&self, sample: &Sample) -> BackgroundRay<R> {
        let Sample { camera, u } = *sample;
        let own = &self.cameras[camera];
        BackgroundRay {
            camera,
            film: FilmPlace { u, size: [own.width, own.height] },
            origin: R::Vec3::of(own.eye),
            direction: R::Vec3::of(own.direction(u)),
        }
    }

    /// The background's radiance along the rays of film samples, whether they hit or not.
    pub fn background_radiance(
        &self,
        samples: impl ExactSizeIterator<Item = Sample>,
    ) -> Vec<R::Vec3> {
        let mut rgb = vec![R::Vec3::zero(); samples.len()];
        match self.background.uniform() {
            Some(uniform) => rgb.fill(uniform),
            None => {
                let rays: Vec<_> = samples.map(|sample| self.background_ray(&sample)).collect();
                self.background.radiance(&rays, &mut rgb);
            }
        }
        rgb
    }

    /// The scene with other options of the tracer.
    pub fn with_options(self, options: trace::Options<R>) -> Self {
        Scene { tracing: Tracing { options, ..self.tracing }, ..self }
    }

    /// The scene whose rays skip the space that this lattice of its field shows to be empty. Closest
    /// approaches with a larger clearance than `reach`, in pixels, do not matter.
    pub fn with_lattice(self, lattice: Option<&'a trace::Lattice<R>>, reach: f64) -> Self {
        Scene { lattice, reach, ..self }
    }

    /// The scene for rays whose closest approaches do not matter from a clearance of `reach` pixels
    /// on: a lattice can skip them.
    pub fn within_reach(self, reach: f64) -> Self {
        Scene { reach: self.reach.min(reach), ..self }
    }

    /// The scene for hits alone: rays start and end near the ball of `Field::bounds`, which holds
    /// the solid, instead of on the bounding sphere.
    ///
    /// The bounding sphere remains if the field gives no ball, or one that is not inside it.
    pub fn clipped_to_solid(self) -> Self {
        let bounds = self.bounding_ball();
        let ball = self.field.bounds().map(|ball| ball.scaled(R::of(SOLID_MARGIN)));
        let ball = ball.filter(|ball| bounds.union(ball) == bounds).unwrap_or(bounds);
        Scene { tracing: Tracing { ball, ..self.tracing }, ..self }
    }

    /// The scene with rays that start and end on the bounding sphere: searches for silhouettes need
    /// room around the solid.
    pub fn clipped_to_bounds(self) -> Self {
        Scene { tracing: Tracing { ball: self.bounding_ball(), ..self.tracing }, ..self }
    }

    /// The bounding sphere in the scene's precision.
    pub fn bounding_ball(&self) -> Sphere<R> {
        in_precision(&self.bounds)
    }

    /// The bounding radius, in world units.
    pub fn radius(&self) -> R {
        R::of(self.bounds.radius)
    }

    /// The tracing scale at the distance `t` from camera number `camera`, in world units: the
    /// bounding radius, or the width of the film at this distance if that is less.
    ///
    /// The lengths in the tracer's options are relative to it. At most 256 pixels of the film count
    /// for its width.
    pub fn tracing_scale(&self, camera: usize, t: R) -> R {
        self.radius().min(self.film_angle(camera) * t)
    }

    /// The width of a camera's film, at most 256 pixels of it, at distance 1, in world units.
    pub(crate) fn film_angle(&self, camera: usize) -> R {
        let camera = &self.cameras[camera];
        let pixels = f64::from(camera.width.max(camera.height)).min(SCALE_PIXELS);
        R::of(camera.pixel_angle() * pixels)
    }
}

fn in_precision<R: Real>(ball: &Sphere<f64>) -> Sphere<R> {
    Sphere { center: R::Vec3::of(ball.center), radius: R::of(ball.radius) }
}
