//! A scene that is ready to be traced.

use field::{Field, Real, Sphere, Vector3};

use crate::{Camera, Shader};

/// A field, its appearance, and the cameras that look at it.
#[derive(Clone, Copy)]
pub struct Scene<'a, R: Real> {
    /// The signed distance.
    pub field: &'a dyn Field<R>,
    /// Radiance at its surface.
    pub shader: &'a dyn Shader<R>,
    /// The cameras that samples refer to.
    pub cameras: &'a [Camera],
    /// The bounding sphere, world units: it holds the solid, with room for a warp around it.
    pub bounds: Sphere<f64>,
    /// Radiance of rays that hit nothing, linear RGB.
    pub background: R::Vec3,
    /// How rays are traced.
    pub tracing: Tracing<R>,
}

/// How rays are traced, and where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracing<R: Real> {
    /// The tracer's options.
    pub options: trace::Options<R>,
    /// The ball in which rays start and end, world units.
    pub ball: Sphere<R>,
}

/// The ball of rays that look for hits only, in radii of the field's own ball: a ray has to start
/// outside the solid, which may touch its ball from inside.
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
        background: R::Vec3,
    ) -> Self {
        let tracing = Tracing { options: trace::Options::default(), ball: in_precision(bounds) };
        Scene { field, shader, cameras, bounds: *bounds, background, tracing }
    }

    /// The same scene with other options of the tracer.
    pub fn with_options(self, options: trace::Options<R>) -> Self {
        Scene { tracing: Tracing { options, ..self.tracing }, ..self }
    }

    /// The same scene for hits alone: rays start and end on the ball that the field says holds the
    /// solid, instead of all of the bounds.
    pub fn clipped_to_solid(self) -> Self {
        let bounds = self.bounding_ball();
        let ball = self.field.bounds().map(|ball| ball.scaled(R::of(SOLID_MARGIN)));
        let ball = ball.filter(|ball| bounds.union(ball) == bounds).unwrap_or(bounds);
        Scene { tracing: Tracing { ball, ..self.tracing }, ..self }
    }

    /// The same scene with rays that start and end on the bounds: searches for silhouettes need
    /// room around the solid.
    pub fn clipped_to_bounds(self) -> Self {
        Scene { tracing: Tracing { ball: self.bounding_ball(), ..self.tracing }, ..self }
    }

    /// The bounding sphere in the scene's precision.
    pub fn bounding_ball(&self) -> Sphere<R> {
        in_precision(&self.bounds)
    }

    /// The bounding radius.
    pub fn radius(&self) -> R {
        R::of(self.bounds.radius)
    }

    /// The length that relative lengths of tracing refer to, at the distance `t` from a camera: the
    /// bounding radius, or the width of the film there if that is less.
    pub fn tracing_scale(&self, camera: usize, t: R) -> R {
        let camera = &self.cameras[camera];
        let pixels = f64::from(camera.width.max(camera.height)).min(SCALE_PIXELS);
        self.radius().min(R::of(camera.pixel_angle() * pixels) * t)
    }
}

fn in_precision<R: Real>(ball: &Sphere<f64>) -> Sphere<R> {
    Sphere { center: R::Vec3::of(ball.center), radius: R::of(ball.radius) }
}
