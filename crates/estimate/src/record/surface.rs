//! Reverse mode of shaded hits: from adjoints of radiance to coefficients of f and ∇f at the hit
//! points.

use field::RayAdjoint;
use field::{PartialSum, Real, SurfaceAdjoint, Vector3};
use render::{Primary, Scene};
use trace::{HitAdjoint, hit_film_derivative, hit_vjp};

/// The coefficients of one hit, for one adjoint δ of its radiance.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceCoefficients<R: Real> {
    /// The coefficient α of f; see [`trace::hit_vjp`].
    pub alpha: R,
    /// The coefficient c of ∇f.
    pub c: R::Vec3,
    /// δ·∂L/∂u: the film gradient of the radiance, in the direction of the adjoint, per pixel.
    pub film: [R; 2],
    /// The adjoint of the ray.
    pub ray: RayAdjoint<R>,
}

/// The adjoints of a hit by a loss that depends on the surface itself, and not by its radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HitBar<R: Real> {
    /// The adjoint of the hit point, per world unit.
    pub x: R::Vec3,
    /// The adjoint of the unit normal.
    pub normal: R::Vec3,
}

/// VJP of (θ; shader parameters) ↦ radiance at the hits of a batch, and points and normals of the
/// hits.
///
/// `adjoint` has one element per hit, and so has the result. `of_hits` has one element per
/// hit, or none. The adjoint of the shader's parameters is added to `shader`.
pub fn surface_vjp<R: Real>(
    scene: &Scene<'_, R>,
    primary: &Primary<R>,
    adjoint: &[R::Vec3],
    of_hits: &[HitBar<R>],
    shader: &mut PartialSum<R>,
) -> Vec<SurfaceCoefficients<R>> {
    let n = primary.hits.len();
    if n == 0 {
        return Vec::new();
    }
    let mut bars = SurfaceAdjoint::zeros(n);
    scene.shader.add_vjp(&primary.surface.batch(), adjoint, &mut bars, shader);
    for (i, own) in of_hits.iter().enumerate() {
        bars.x[i] += own.x;
        bars.normal[i] += own.normal;
    }
    if bars.is_zero() {
        // The radiance does not depend on the hit points.
        let zero = R::zero();
        let (c, ray) = (R::Vec3::zero(), RayAdjoint::zero());
        return vec![SurfaceCoefficients { alpha: zero, c, film: [zero; 2], ray }; n];
    }
    let m = add_normal_adjoint(scene, primary, &mut bars);
    (0..n)
        .map(|i| {
            let hit = &primary.hits[i];
            let (g, d, x_bar) = (hit.gradient, primary.surface.direction[i], bars.x[i]);
            let HitAdjoint { alpha, c } = hit_vjp::<R>(g, d, x_bar, m[i]);
            let sample = primary.samples[hit.sample].sample;
            let (_, du) = scene.cameras[sample.camera].direction_du(sample.u);
            let film = du.map(|du| {
                let du = R::Vec3::of(du);
                let x_du = hit_film_derivative::<R>(g, d, hit.t, du);
                x_bar.dot(x_du) + bars.direction[i].dot(du)
            });
            // The point moves by (I − d ∇fᵀ/(∇f·d)) (∂o + t ∂d): it stays on the surface.
            let origin = x_bar + g * alpha;
            let direction = origin * hit.t + bars.direction[i];
            SurfaceCoefficients { alpha, c, film, ray: RayAdjoint { origin, direction } }
        })
        .collect()
}

/// Adds the dependence of the normal on the hit point to the adjoint of the point, x̄ + ∇²f m, and
/// returns m of every hit; see [`HitAdjoint::normal_coefficient`].
///
/// Hits with m = 0, whose radiance does not depend on the normal, need no Hessian.
fn add_normal_adjoint<R: Real>(
    scene: &Scene<'_, R>,
    primary: &Primary<R>,
    bars: &mut SurfaceAdjoint<R>,
) -> Vec<R::Vec3> {
    let m: Vec<R::Vec3> = primary
        .hits
        .iter()
        .zip(&bars.normal)
        .map(|(hit, bar)| HitAdjoint::<R>::normal_coefficient(hit.gradient, *bar))
        .collect();
    let turned: Vec<usize> = (0..m.len()).filter(|&i| m[i] != R::Vec3::zero()).collect();
    let pick = |from: &[R::Vec3]| turned.iter().map(|&i| from[i]).collect::<Vec<_>>();
    let zero = vec![R::Vec3::zero(); turned.len()];
    let (mut gradient, mut product) = (zero.clone(), zero);
    let x = pick(&primary.surface.x);
    scene.field.hessian_vector(&x, &pick(&m), &mut gradient, &mut product);
    for (&i, product) in turned.iter().zip(product) {
        bars.x[i] += product;
    }
    m
}
