//! The warp at film samples: from the tracer's record to coefficients of f and ∇f.

use field::{Real, Sphere, Vector3};
use render::{Camera, Primary, Sample, Scene};
use trace::{Ray, Visits, entry_derivative, exit_derivative, visit};
use warp::{
    Pinhole, Warp, WarpWithDivergence, WarpedRay, Weighting, evaluate, evaluate_with_divergence,
};

use crate::record::adjoints::{Adjoints, PointAdjoint};

/// V at film samples. It is zero at samples whose rays miss the ball of rays.
#[derive(Debug)]
pub struct FilmWarp<R: Real> {
    warp: Warp<R>,
    /// The sample of every ray of `warp`.
    sample: Vec<usize>,
}

/// V and ∇_u·V at film samples.
#[derive(Debug)]
pub struct FilmWarpWithDivergence<R: Real> {
    warp: WarpWithDivergence<R>,
    /// The sample of every ray of `warp`.
    sample: Vec<usize>,
}

/// The chart of a camera: its projection from world to film.
pub fn chart(camera: &Camera) -> Pinhole {
    let (axes, focal) = ([camera.right, -camera.up], camera.focal.to_array());
    Pinhole { eye: camera.eye, forward: camera.forward, axes, focal }
}

/// The rays of film samples, with the N points that plain sphere tracing visits along each.
struct VisitedRays<'a, R: Real> {
    scene: &'a Scene<'a, R>,
    primary: &'a Primary<R>,
    /// The samples that have a ray.
    with_ray: Vec<usize>,
    rays: Vec<Ray<R>>,
    visits: Visits<R>,
    charts: Vec<Pinhole>,
}

impl<'a, R: Real> VisitedRays<'a, R> {
    fn new(scene: &'a Scene<'a, R>, primary: &'a Primary<R>, points: usize) -> Self {
        let samples = primary.samples.iter().enumerate();
        let with_ray = samples.filter(|(_, s)| s.ray.is_some()).map(|(i, _)| i).collect();
        let rays: Vec<Ray<R>> = primary.rays.iter().map(|traced| traced.ray).collect();
        let visits = visit(scene.field, &rays, points, scene.tracing.options.relaxation);
        let charts = scene.cameras.iter().map(chart).collect();
        VisitedRays { scene, primary, with_ray, rays, visits, charts }
    }

    fn charts(&self) -> Vec<&Pinhole> {
        (0..self.rays.len()).map(|r| &self.charts[self.sample(r).camera]).collect()
    }

    /// The sample of ray `r`.
    fn sample(&self, r: usize) -> Sample {
        self.primary.samples[self.with_ray[r]].sample
    }

    fn warped(&self) -> Vec<WarpedRay<'_, R>> {
        let ball = self.scene.bounding_ball();
        (0..self.rays.len()).map(|r| self.warped_ray(r, &ball)).collect()
    }

    fn warped_ray(&self, r: usize, ball: &Sphere<R>) -> WarpedRay<'_, R> {
        let (ray, sample) = (&self.rays[r], self.sample(r));
        let (_, du) = self.scene.cameras[sample.camera].direction_du(sample.u);
        let du = du.map(|du| R::Vec3::of(du));
        let visited = self.visits.ray(r);
        WarpedRay {
            origin: ray.origin,
            direction: ray.direction,
            direction_du: du,
            entry_du: du.map(|du| entry_derivative(ray, ball, du)),
            exit_du: du.map(|du| exit_derivative(ray, ball, du)),
            relaxation: self.scene.tracing.options.relaxation,
            t: visited.t,
            f: visited.f,
            gradient: visited.gradient,
            step: visited.step,
            clamped: visited.clamped,
            valid: visited.valid,
        }
    }
}

/// V at the samples of `primary`, from `points` points per ray, of which the `k` of largest weight
/// are used.
pub fn warp_samples<R: Real>(
    scene: &Scene<'_, R>,
    primary: &Primary<R>,
    points: usize,
    weighting: &dyn Weighting<R>,
    k: usize,
) -> FilmWarp<R> {
    let visited = VisitedRays::new(scene, primary, points);
    let warp = evaluate(weighting, k, &visited.charts(), &visited.warped());
    FilmWarp { warp, sample: visited.with_ray }
}

/// V and ∇_u·V at the samples of `primary`, from `points` points per ray, of which the `k` of
/// largest weight are used.
pub fn warp_samples_with_divergence<R: Real>(
    scene: &Scene<'_, R>,
    primary: &Primary<R>,
    points: usize,
    weighting: &dyn Weighting<R>,
    k: usize,
) -> FilmWarpWithDivergence<R> {
    let visited = VisitedRays::new(scene, primary, points);
    let (charts, rays) = (visited.charts(), visited.warped());
    let warp = evaluate_with_divergence(scene.field, weighting, k, &charts, &rays);
    FilmWarpWithDivergence { warp, sample: visited.with_ray }
}

/// The elements of `values` at the samples of the rays.
fn pick<T: Copy>(values: &[T], sample: &[usize]) -> Vec<T> {
    sample.iter().map(|&i| values[i]).collect()
}

impl<R: Real> FilmWarpWithDivergence<R> {
    /// A warp, with the number of the film sample of each of its rays.
    pub fn new(warp: WarpWithDivergence<R>, sample: Vec<usize>) -> Self {
        FilmWarpWithDivergence { warp, sample }
    }

    /// VJP of θ ↦ (V, ∇_u·V) at area samples; see [`WarpWithDivergence::area_vjp`].
    ///
    /// `scalar` and `film` have one adjoint per sample, `pixel` gives the pixel of a sample.
    pub(crate) fn area_vjp(
        &self,
        scalar: &[R],
        film: &[[R; 2]],
        pixel: impl Fn(usize) -> u32,
        out: &mut Adjoints<R>,
    ) {
        let (alpha, c) = self.coefficients(scalar, film);
        for ((point, alpha), c) in self.warp.warp.samples.iter().zip(alpha).zip(c) {
            out.push(pixel(self.sample[point.ray]), PointAdjoint { x: point.x, alpha, c });
        }
    }

    /// Adds to `total`, which has one element per sample, the sum of the coefficients of f from
    /// [`area_vjp`](Self::area_vjp).
    pub(crate) fn add_area_totals(&self, scalar: &[R], film: &[[R; 2]], total: &mut [R]) {
        let (alpha, _) = self.coefficients(scalar, film);
        for (point, alpha) in self.warp.warp.samples.iter().zip(alpha) {
            total[self.sample[point.ray]] += alpha;
        }
    }

    fn coefficients(&self, scalar: &[R], film: &[[R; 2]]) -> (Vec<R>, Vec<R::Vec3>) {
        self.warp.area_vjp(&pick(scalar, &self.sample), &pick(film, &self.sample))
    }
}

impl<R: Real> FilmWarp<R> {
    /// VJP of θ ↦ −V·n at boundary samples; see [`Warp::flux_vjp`].
    ///
    /// `flux` has one adjoint per sample, `axis` the film axis of its normal, `pixel` its pixel.
    pub(crate) fn flux_vjp(
        &self,
        flux: &[R],
        axis: &[usize],
        pixel: &[u32],
        out: &mut Adjoints<R>,
    ) {
        let alpha = self.warp.flux_vjp(&pick(flux, &self.sample), &pick(axis, &self.sample));
        for (point, alpha) in self.warp.samples.iter().zip(alpha) {
            let pixel = pixel[self.sample[point.ray]];
            out.push(pixel, PointAdjoint { x: point.x, alpha, c: R::Vec3::zero() });
        }
    }
}
