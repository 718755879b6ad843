//! Camera rays: where they hit, and the radiance they bring back.

use field::{Field, Real, Sphere, SurfaceBatch, Vector3};
use glam::DVec2;
use rustc_hash::FxHashMap;
use trace::{Intersection, Outcome, Ray};
use warp::Weighting;

use render::Camera;
use render::Shader;

/// N of the published estimator.
pub(super) const PUBLISHED_STEPS: usize = 22;

/// What every estimator needs to know.
#[derive(Clone, Copy)]
pub struct Setup<'a, R: Real> {
    /// The signed distance.
    pub field: &'a dyn Field<R>,
    /// Radiance at its surface.
    pub shader: &'a dyn Shader<R>,
    /// The cameras that samples refer to.
    pub cameras: &'a [Camera],
    /// Where the scene starts and ends, with room for a warp around the solid.
    pub bounds: Sphere<R>,
    /// Where rays start and end: the bounds, unless [`Setup::hugged`].
    pub(crate) within: Sphere<R>,
    /// Radiance of rays that hit nothing, linear RGB.
    pub background: R::Vec3,
    /// How rays are traced.
    pub trace: trace::Options<R>,
    /// The warp's exponents and guards.
    pub warp: warp::Options<R>,
    /// Weights of the warp other than the published ones, for [`super::Method::Custom`].
    pub weighting: Option<&'a dyn Weighting<R>>,
    /// N: the points of T(u).
    pub steps: usize,
    /// Whether records hold more than silhouettes: the pixels' values, and how these change where
    /// they are smooth.
    pub(crate) smooth: bool,
}

/// A position on the film of one camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The index of the camera.
    pub camera: usize,
    /// The film position, in pixels.
    pub u: DVec2,
}

/// The first hits of a batch of samples.
#[derive(Clone, Debug)]
pub struct Primary<R: Real> {
    /// The ray of every sample, unless it misses the bounding sphere.
    pub rays: Vec<Option<Ray<R>>>,
    /// What the tracer found of every sample; `None` where there is no ray.
    pub found: Vec<Option<Intersection<R>>>,
    /// The radiance of every sample.
    pub radiance: Vec<R::Vec3>,
    /// The samples that hit, in order.
    pub hits: Vec<usize>,
    /// The hit points.
    pub x: Vec<R::Vec3>,
    /// ∇f at the hit points.
    pub gradient: Vec<R::Vec3>,
    /// The unit normals there.
    pub normal: Vec<R::Vec3>,
    /// The unit view directions of the hits.
    pub direction: Vec<R::Vec3>,
    /// The distances of the hits.
    pub t: Vec<R>,
    /// Samples on which a NaN or an infinity was met: the first such sample.
    pub invalid: Option<usize>,
}

/// A camera inside the bounding ball, or this close to it in bounding radii, starts half-way to the
/// nearest surface: the chart is singular at the eye.
const AT_THE_EYE: f64 = 1e-3;

/// A camera this close to the bounding ball, in its radii, may see surfaces that are small beside
/// it; how near these are is asked of the field.
const CLOSE: f64 = 0.5;

/// A film counts as no more than this many pixels wide: a large image is to show what is small in
/// it.
const FINE: f64 = 256.0;

/// Nothing is measured by less than this part of the bounding radius: an eye on a surface has
/// nothing near to go by.
const FINEST: f64 = 1e-6;

/// The radius of a ball that a solid may touch from inside, in radii of the field's own: a ray has
/// to start outside of the solid.
const HUG: f64 = 1.02;

/// The way from the eye to the nearest surface.
fn clear_of_the_eye<R: Real>(field: &dyn Field<R>, eye: R::Vec3) -> R {
    let mut f = [R::zero()];
    field.value(&[eye], &mut f);
    f[0].max(R::zero())
}

impl<R: Real> Primary<R> {
    /// Keeps some samples.
    pub(super) fn retain(&mut self, keep: &[bool]) {
        let mut number = 0;
        let renamed: Vec<usize> = keep
            .iter()
            .map(|keep| {
                number += usize::from(*keep);
                number.wrapping_sub(1)
            })
            .collect();
        let hits: Vec<bool> = self.hits.iter().map(|&i| keep[i]).collect();
        filter(&mut self.rays, keep);
        filter(&mut self.found, keep);
        filter(&mut self.radiance, keep);
        filter(&mut self.hits, &hits);
        filter(&mut self.x, &hits);
        filter(&mut self.gradient, &hits);
        filter(&mut self.normal, &hits);
        filter(&mut self.direction, &hits);
        filter(&mut self.t, &hits);
        self.hits.iter_mut().for_each(|i| *i = renamed[*i]);
    }
}

/// Keeps the elements that are flagged.
pub(super) fn filter<T>(values: &mut Vec<T>, keep: &[bool]) {
    let mut keep = keep.iter();
    values.retain(|_| keep.next() == Some(&true));
}

impl<'a, R: Real> Setup<'a, R> {
    /// A setup with the default tracer and the published warp.
    pub fn new(
        field: &'a dyn Field<R>,
        shader: &'a dyn Shader<R>,
        cameras: &'a [Camera],
        bounds: &Sphere<f64>,
        background: R::Vec3,
    ) -> Self {
        let bounds = Sphere { center: R::Vec3::of(bounds.center), radius: R::of(bounds.radius) };
        let (trace, warp) = (trace::Options::default(), warp::Options::default());
        let (within, steps) = (bounds, PUBLISHED_STEPS);
        Setup {
            field,
            shader,
            cameras,
            bounds,
            within,
            background,
            trace,
            warp,
            weighting: None,
            steps,
            smooth: true,
        }
    }

    /// The same for what needs nothing but hits: rays are followed in the ball that the field says
    /// holds the solid, not in all of the bounds.
    pub(super) fn hugged(mut self) -> Self {
        let ball = self.field.bounds().map(|ball| ball.scaled(R::of(HUG)));
        self.within =
            ball.filter(|ball| self.bounds.union(ball) == self.bounds).unwrap_or(self.bounds);
        self
    }
}

impl<R: Real> Setup<'_, R> {
    /// L − c for the warp's terms, c the background. Any constant c gives the same derivative where
    /// V is continuous; this one is right at the bounding sphere's outline too, where V ends and
    /// there is nothing but background to carry.
    pub fn excess(&self, radiance: R::Vec3) -> R::Vec3 {
        radiance - self.background
    }

    /// The ray of every sample that meets the ball that rays are followed in.
    pub fn rays(&self, samples: &[Sample]) -> Vec<Option<Ray<R>>> {
        let mut clear = FxHashMap::default();
        samples
            .iter()
            .map(|sample| {
                let camera = &self.cameras[sample.camera];
                let eye = R::Vec3::of(camera.eye);
                let mut ray =
                    Ray::enter(eye, R::Vec3::of(camera.direction(sample.u)), &self.within)?;
                let mut nearest = ray.near;
                if ray.near < self.bounds.radius * R::of(CLOSE) {
                    let clear = *clear
                        .entry(sample.camera)
                        .or_insert_with(|| clear_of_the_eye(self.field, eye));
                    nearest = nearest.max(clear);
                    if ray.near < self.bounds.radius * R::of(AT_THE_EYE) {
                        ray.near = (clear * R::of(0.5)).max(ray.near).min(ray.far);
                    }
                }
                ray.scale =
                    self.scale_at(sample.camera, nearest).max(self.bounds.radius * R::of(FINEST));
                Some(ray)
            })
            .collect()
    }

    /// The length that settings relative to the scene refer to, for what is `t` away from a camera:
    /// the bounding radius, or the width of the film there if that is less.
    pub(super) fn scale_at(&self, camera: usize, t: R) -> R {
        let camera = &self.cameras[camera];
        let pixels = f64::from(camera.width.max(camera.height)).min(FINE);
        self.bounds.radius.min(R::of(camera.pixel_angle() * pixels) * t)
    }

    /// The distance at which a sample's line of sight passes the centre of the ball of rays, which
    /// it misses, and the tangent of the angle by which it clears the ball; 0 and infinity if that
    /// is behind.
    pub(super) fn beside(&self, sample: &Sample) -> (R, R) {
        let camera = &self.cameras[sample.camera];
        let (direction, away) =
            (R::Vec3::of(camera.direction(sample.u)), self.within.center - R::Vec3::of(camera.eye));
        let nearest = away.dot(direction);
        let gap = (away - direction * nearest).length() - self.within.radius;
        if nearest > R::zero() {
            (nearest, gap.max(R::zero()) / nearest)
        } else {
            (R::zero(), R::infinity())
        }
    }

    /// The ray of every sample, and what the tracer found along it; `None` where there is no ray.
    #[allow(clippy::type_complexity, reason = "two columns")]
    pub fn find(&self, samples: &[Sample]) -> (Vec<Option<Ray<R>>>, Vec<Option<Intersection<R>>>) {
        let rays = self.rays(samples);
        let traced: Vec<Ray<R>> = rays.iter().flatten().copied().collect();
        let mut intersections = Vec::with_capacity(traced.len());
        trace::intersect(self.field, &traced, &self.trace, &mut intersections);
        let mut next = intersections.into_iter();
        let found = rays.iter().map(|ray| ray.and_then(|_| next.next())).collect();
        (rays, found)
    }

    /// Traces and shades a batch.
    pub fn primary(&self, samples: &[Sample]) -> Primary<R> {
        let (rays, found) = self.find(samples);
        let (mut hits, mut x, mut direction, mut t) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut invalid = None;
        for (i, (ray, found)) in rays.iter().zip(&found).enumerate() {
            let (Some(ray), Some(found)) = (ray, found) else { continue };
            match found.outcome {
                Outcome::Hit => {
                    hits.push(i);
                    x.push(ray.origin + ray.direction * found.t);
                    direction.push(ray.direction);
                    t.push(found.t);
                }
                Outcome::Invalid => invalid = invalid.or(Some(i)),
                Outcome::Miss | Outcome::Inside => {}
            }
        }
        let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
        self.field.value_gradient(&x, &mut f, &mut gradient);
        let normal = normals::<R>(&gradient);
        let mut rgb = vec![R::Vec3::zero(); x.len()];
        let points = SurfaceBatch { x: &x, normal: &normal, direction: &direction };
        self.shader.radiance(&points, &mut rgb);
        let mut radiance = vec![self.background; samples.len()];
        for (hit, rgb) in hits.iter().zip(rgb) {
            radiance[*hit] = rgb;
        }
        Primary { rays, found, radiance, hits, x, gradient, normal, direction, t, invalid }
    }
}

/// Unit normals from gradients.
pub(super) fn normals<R: Real>(gradient: &[R::Vec3]) -> Vec<R::Vec3> {
    gradient.iter().map(|g| *g * (R::one() / g.length().max(R::min_positive_value()))).collect()
}
