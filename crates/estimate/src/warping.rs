//! From the tracer's record to the warp of film samples, and from there to the field's parameters.

use field::{Real, Vector3};
use trace::{Ray, entry_derivative, exit_derivative, visit};
use warp::{Kept, WarpedRay, evaluate_with};

use super::adjoints::Adjoints;
use super::{Sample, Setup};

/// The warp of a batch of film samples.
pub struct Warped<R: Real> {
    kept: Kept<R>,
    /// The sample of every ray: those that miss the bounding sphere have none.
    sample: Vec<usize>,
}

impl<R: Real> Setup<'_, R> {
    /// Visits N points along every ray and weighs them; with `divergence` the second derivatives
    /// too.
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
        let weighting = self.weighting.unwrap_or(&self.warp);
        Warped {
            kept: evaluate_with(self.field, &self.warp, weighting, &charts, &warped, divergence),
            sample,
        }
    }
}

impl<R: Real> Warped<R> {
    /// The warp that a batch of points makes: `sample` is the sample of each of its rays.
    pub(super) fn new(kept: Kept<R>, sample: Vec<usize>) -> Self {
        Warped { kept, sample }
    }

    /// Reverse mode of area samples; see [`Kept::area_vjp`]. One adjoint and one pixel a sample.
    pub fn area_vjp(&self, scalar: &[R], film: &[[R; 2]], pixel: &[u32], out: &mut Adjoints<R>) {
        let scalar: Vec<R> = self.sample.iter().map(|&i| scalar[i]).collect();
        let film: Vec<[R; 2]> = self.sample.iter().map(|&i| film[i]).collect();
        let (alpha, c) = self.kept.area_vjp(&scalar, &film);
        for (i, (alpha, c)) in alpha.into_iter().zip(c).enumerate() {
            out.push(pixel[self.sample[self.kept.ray[i]]], self.kept.points[i], alpha, c);
        }
    }

    /// Adds to each sample's entry of `total` the sum of the coefficients of f that
    /// [`area_vjp`](Self::area_vjp) would give it.
    pub fn add_area_totals(&self, scalar: &[R], film: &[[R; 2]], total: &mut [R]) {
        let own: Vec<R> = self.sample.iter().map(|&i| scalar[i]).collect();
        let film: Vec<[R; 2]> = self.sample.iter().map(|&i| film[i]).collect();
        let (alpha, _) = self.kept.area_vjp(&own, &film);
        for (alpha, &ray) in alpha.iter().zip(&self.kept.ray) {
            total[self.sample[ray]] += *alpha;
        }
    }

    /// Reverse mode of boundary samples; see [`Kept::flux_vjp`]. One adjoint, one axis and one
    /// pixel a sample.
    pub fn flux_vjp(&self, flux: &[R], axis: &[usize], pixel: &[u32], out: &mut Adjoints<R>) {
        let own: Vec<R> = self.sample.iter().map(|&i| flux[i]).collect();
        let axis: Vec<usize> = self.sample.iter().map(|&i| axis[i]).collect();
        for (i, alpha) in self.kept.flux_vjp(&own, &axis).into_iter().enumerate() {
            out.push(
                pixel[self.sample[self.kept.ray[i]]],
                self.kept.points[i],
                alpha,
                R::Vec3::zero(),
            );
        }
    }
}
