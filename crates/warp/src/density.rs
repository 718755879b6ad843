//! The density of a warp's weights along a ray: the part in which warps differ.

use field::{Real, Vector3};

use crate::ray::WarpedRay;

/// The motion of a point as u moves along one film axis: derivatives per pixel.
#[derive(Clone, Copy, Debug)]
pub struct Motion<R: Real> {
    /// ∂d.
    pub direction: R::Vec3,
    /// ∂t of the point, in world units per pixel.
    pub t: R,
    /// ∂t of the end of the interval, in world units per pixel.
    pub exit: R,
    /// ∂x of the point, in world units per pixel.
    pub x: R::Vec3,
    /// ∂∇f = ∇²f ∂x.
    pub gradient: R::Vec3,
}

/// The density ρ of a warp's weights along a ray: w = ρ Δ, for the length Δ that a point stands
/// for.
///
/// The selection of the k largest weights, the shift and the normalisation are the same for every
/// density. ρ should tend to infinity at silhouette points, faster than 1/S², and nowhere else; S
/// is that of [`PublishedWeighting`].
pub trait Weighting<R: Real>: Send + Sync {
    /// ln ρ of point `i` of a ray of finite numbers. Only differences matter, so no exponent
    /// overflows.
    fn log_density(&self, ray: &WarpedRay<'_, R>, i: usize) -> R;

    /// ∂ ln ρ as the point moves, per pixel.
    fn log_density_rate(&self, ray: &WarpedRay<'_, R>, i: usize, motion: &Motion<R>) -> R;
}

/// The published density ρ = S^−γ with S = |f| + λ_d |∇f·d| + ε (Bangaru et al. 2022, supplement,
/// section 1). [`crate::WarpOptions::weighting`] makes one from lengths in bounding radii.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PublishedWeighting<R> {
    /// γ. Above 2 the weights tend to a delta at a silhouette.
    pub gamma: R,
    /// λ_d, in world units.
    pub lambda_d: R,
    /// ε, in world units.
    pub epsilon: R,
}

impl<R: Real> PublishedWeighting<R> {
    /// S, kept away from zero: ln 0 would be infinite.
    fn spread(&self, ray: &WarpedRay<'_, R>, i: usize) -> R {
        let facing = ray.gradient[i].dot(ray.direction).abs();
        (ray.f[i].abs() + self.lambda_d * facing + self.epsilon).max(R::min_positive_value())
    }
}

impl<R: Real> Weighting<R> for PublishedWeighting<R> {
    fn log_density(&self, ray: &WarpedRay<'_, R>, i: usize) -> R {
        -self.gamma * self.spread(ray, i).ln()
    }

    fn log_density_rate(&self, ray: &WarpedRay<'_, R>, i: usize, motion: &Motion<R>) -> R {
        let sign = |v: R| if v < R::zero() { -R::one() } else { R::one() };
        let f_rate = ray.gradient[i].dot(motion.x);
        let facing_rate =
            motion.gradient.dot(ray.direction) + ray.gradient[i].dot(motion.direction);
        let facing_sign = sign(ray.gradient[i].dot(ray.direction));
        let spread_rate = sign(ray.f[i]) * f_rate + self.lambda_d * facing_sign * facing_rate;
        -(self.gamma * spread_rate / self.spread(ray, i))
    }
}
