//! From the tracer's record to the warp of film samples, and from there to the field's parameters.

use field::{Field, Real, Vector3};
use trace::{Ray, entry_derivative, exit_derivative, visit};
use warp::{Kept, WarpedRay};

use super::image::one_hot;
use super::{Sample, Setup};

/// Points at which the parameter gradient of α f + c·∇f is to be added up.
#[derive(Clone, Debug)]
pub struct Adjoints<R: Real> {
    x: Vec<R::Vec3>,
    alpha: Vec<R>,
    c: Vec<R::Vec3>,
}

impl<R: Real> Default for Adjoints<R> {
    fn default() -> Self {
        Adjoints { x: Vec::new(), alpha: Vec::new(), c: Vec::new() }
    }
}

impl<R: Real> Adjoints<R> {
    /// Adds a point.
    pub fn push(&mut self, x: R::Vec3, alpha: R, c: R::Vec3) {
        self.x.push(x);
        self.alpha.push(alpha);
        self.c.push(c);
    }

    /// Adds the parameter gradient of all points to `sum`, in one pass. Points without weight cost nothing.
    pub fn backward(mut self, field: &dyn Field<R>, sum: &mut [R]) {
        let keep: Vec<bool> =
            self.alpha.iter().zip(&self.c).map(|(a, c)| *a != R::zero() || *c != R::Vec3::zero()).collect();
        let mut flags = keep.iter();
        self.x.retain(|_| flags.next() == Some(&true));
        let mut flags = keep.iter();
        self.alpha.retain(|_| flags.next() == Some(&true));
        let mut flags = keep.iter();
        self.c.retain(|_| flags.next() == Some(&true));
        field.parameter_vjp(&self.x, &self.alpha, &self.c, sum);
    }
}

/// The warp of a batch of film samples.
pub struct Warped<R: Real> {
    kept: Kept<R>,
    /// The sample of every ray: those that miss the bounding sphere have none.
    sample: Vec<usize>,
}

impl<R: Real> Setup<'_, R> {
    /// Visits N points along every ray and weighs them; with `divergence` the second derivatives too.
    pub fn warp(&self, samples: &[Sample], rays: &[Option<Ray<R>>], divergence: bool) -> Warped<R> {
        let sample: Vec<usize> = (0..samples.len()).filter(|&i| rays[i].is_some()).collect();
        let traced: Vec<Ray<R>> = rays.iter().flatten().copied().collect();
        let visits = visit(self.field, &traced, self.steps, self.warp.relaxation);
        let warped: Vec<WarpedRay<'_, R>> = traced
            .iter()
            .zip(&sample)
            .enumerate()
            .map(|(r, (ray, &i))| {
                let (_, du) = self.cameras[samples[i].camera].direction_du(samples[i].u);
                let du = du.map(|du| R::Vec3::of(du));
                let visited = visits.ray(r);
                WarpedRay {
                    origin: ray.origin,
                    direction: ray.direction,
                    direction_du: du,
                    entry_du: du.map(|du| entry_derivative(ray, &self.bounds, du)),
                    exit_du: du.map(|du| exit_derivative(ray, &self.bounds, du)),
                    t: visited.t,
                    f: visited.f,
                    gradient: visited.gradient,
                    step: visited.step,
                    clamped: visited.clamped,
                    valid: visited.valid,
                }
            })
            .collect();
        let charts: Vec<_> = sample.iter().map(|&i| &self.cameras[samples[i].camera]).collect();
        Warped { kept: warp::evaluate(self.field, &self.warp, &charts, &warped, divergence), sample }
    }
}

impl<R: Real> Warped<R> {
    /// V and, if it was asked for, ∇·V of each of `samples` samples, by the field's parameter `index`.
    pub(super) fn forward(&self, setup: &Setup<'_, R>, index: usize, samples: usize) -> (Vec<[R; 2]>, Vec<R>) {
        let n = self.kept.points.len();
        let (mut f, mut g) = (vec![R::zero(); n], vec![R::Vec3::zero(); n]);
        let tangent = one_hot(setup.field.parameter_count(), index);
        setup.field.parameter_jvp(&self.kept.points, &tangent, &mut f, &mut g);
        let (mut velocity, mut divergence) = (vec![[R::zero(); 2]; samples], vec![R::zero(); samples]);
        for (v, &i) in self.kept.velocity(&f).into_iter().zip(&self.sample) {
            velocity[i] = v;
        }
        if self.kept.divergence_a.len() == n {
            for (d, &i) in self.kept.divergence(&f, &g).into_iter().zip(&self.sample) {
                divergence[i] = d;
            }
        }
        (velocity, divergence)
    }

    /// Reverse mode of area samples; see [`Kept::area_vjp`]. One adjoint a sample.
    pub fn area_vjp(&self, scalar: &[R], film: &[[R; 2]], out: &mut Adjoints<R>) {
        let scalar: Vec<R> = self.sample.iter().map(|&i| scalar[i]).collect();
        let film: Vec<[R; 2]> = self.sample.iter().map(|&i| film[i]).collect();
        let (alpha, c) = self.kept.area_vjp(&scalar, &film);
        for ((x, alpha), c) in self.kept.points.iter().zip(alpha).zip(c) {
            out.push(*x, alpha, c);
        }
    }

    /// Adds to each sample's entry of `total` the sum of the coefficients of f that [`area_vjp`](Self::area_vjp) would give it.
    pub fn add_area_totals(&self, scalar: &[R], film: &[[R; 2]], total: &mut [R]) {
        let own: Vec<R> = self.sample.iter().map(|&i| scalar[i]).collect();
        let film: Vec<[R; 2]> = self.sample.iter().map(|&i| film[i]).collect();
        let (alpha, _) = self.kept.area_vjp(&own, &film);
        for (alpha, &ray) in alpha.iter().zip(&self.kept.ray) {
            total[self.sample[ray]] += *alpha;
        }
    }

    /// Reverse mode of boundary samples; see [`Kept::flux_vjp`]. One adjoint and one axis a sample.
    pub fn flux_vjp(&self, flux: &[R], axis: &[usize], out: &mut Adjoints<R>) {
        let of = |values: &[usize]| self.sample.iter().map(|&i| values[i]).collect::<Vec<_>>();
        let flux: Vec<R> = self.sample.iter().map(|&i| flux[i]).collect();
        for (x, alpha) in self.kept.points.iter().zip(self.kept.flux_vjp(&flux, &of(axis))) {
            out.push(*x, alpha, R::Vec3::zero());
        }
    }
}
