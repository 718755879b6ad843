//! Reverse mode of a shaded hit: from an adjoint of radiance to coefficients on f and ∇f at the hit
//! point.

use field::{Real, SurfaceBatch, Vector3};
use trace::{HitAdjoint, hit_film_derivative, hit_vjp};

use super::{Primary, Sample, Setup};

/// Adjoints of the hits of a batch, for one adjoint of radiance a hit.
#[derive(Clone, Debug)]
pub struct SurfaceAdjoint<R: Real> {
    /// The coefficient α of f, a hit; see [`trace::hit_vjp`].
    pub alpha: Vec<R>,
    /// The coefficient c of ∇f, a hit.
    pub c: Vec<R::Vec3>,
    /// δ·∂L/∂u: the film gradient of radiance seen through the adjoint, a hit, per pixel.
    pub film: Vec<[R; 2]>,
}

impl<R: Real> Setup<'_, R> {
    /// VJP of a batch's radiance. `adjoint` has one element a hit; the shader's parameter adjoint
    /// is added to `shader`.
    pub fn surface_vjp(
        &self,
        samples: &[Sample],
        primary: &Primary<R>,
        adjoint: &[R::Vec3],
        shader: &mut [R],
    ) -> SurfaceAdjoint<R> {
        let n = primary.hits.len();
        let mut bars = field::SurfaceAdjoint::zeros(n);
        let (x, direction) = (&primary.x, &primary.direction);
        let points = SurfaceBatch { x, normal: &primary.normal, direction };
        self.shader.vjp(&points, adjoint, &mut bars, shader);
        if bars.is_zero() {
            // Radiance that is the same everywhere does not care where its ray hits.
            let (alpha, c) = (vec![R::zero(); n], vec![R::Vec3::zero(); n]);
            return SurfaceAdjoint { alpha, c, film: vec![[R::zero(); 2]; n] };
        }
        let m: Vec<R::Vec3> = (0..n)
            .map(|i| HitAdjoint::<R>::normal_coefficient(primary.gradient[i], bars.normal[i]))
            .collect();
        // Without an adjoint, or where radiance does not look at the normal, no Hessian is needed.
        let turned: Vec<usize> = (0..n).filter(|&i| m[i] != R::Vec3::zero()).collect();
        let pick = |from: &[R::Vec3]| turned.iter().map(|&i| from[i]).collect::<Vec<_>>();
        let (mut gradient, mut product) =
            (vec![R::Vec3::zero(); turned.len()], vec![R::Vec3::zero(); turned.len()]);
        self.field.hessian_vector(&pick(x), &pick(&m), &mut gradient, &mut product);
        for (&i, product) in turned.iter().zip(product) {
            bars.x[i] += product;
        }
        let (mut alpha, mut c, mut film) =
            (Vec::with_capacity(n), Vec::with_capacity(n), Vec::with_capacity(n));
        for i in 0..n {
            let (g, d, t) = (primary.gradient[i], direction[i], primary.t[i]);
            let hit = hit_vjp::<R>(g, d, bars.x[i], m[i]);
            alpha.push(hit.alpha);
            c.push(hit.c);
            let sample = &samples[primary.hits[i]];
            let (_, du) = self.cameras[sample.camera].direction_du(sample.u);
            film.push(du.map(|du| {
                let du = R::Vec3::of(du);
                bars.x[i].dot(hit_film_derivative::<R>(g, d, t, du)) + bars.direction[i].dot(du)
            }));
        }
        SurfaceAdjoint { alpha, c, film }
    }
}

#[cfg(test)]
#[path = "surface_tests.rs"]
mod tests;
