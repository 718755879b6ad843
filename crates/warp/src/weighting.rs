//! What makes one warp different from another: how much a point weighs.

use field::{Real, Vector3};

use crate::{Options, WarpedRay};

/// How a point moves as u moves along one film axis.
#[derive(Clone, Copy, Debug)]
pub struct Motion<R: Real> {
    /// ∂d.
    pub direction: R::Vec3,
    /// ∂t of the point.
    pub t: R,
    /// ∂t of the interval's end.
    pub exit: R,
    /// ∂x.
    pub x: R::Vec3,
    /// ∂∇f = ∇²f ∂x.
    pub gradient: R::Vec3,
}

/// The density ρ of a warp's weights along a ray: w = ρ Δ, for the length Δ that a point stands
/// for. What is made of them (the k largest, shifted and normalised) is the same for all.
///
/// [`Options`] are the published one, ρ = S^−γ. For another, see [`crate::evaluate_with`]. ρ should
/// tend to infinity at silhouette points, faster than 1/S², and nowhere else.
pub trait Weighting<R: Real>: Send + Sync {
    /// ln ρ of point `i` of a ray of finite numbers. No more than differences matter, so that
    /// nothing overflows.
    fn log_density(&self, ray: &WarpedRay<'_, R>, i: usize) -> R;

    /// ∂ ln ρ as the point moves, per pixel.
    fn log_density_rate(&self, ray: &WarpedRay<'_, R>, i: usize, motion: &Motion<R>) -> R;
}

/// S = |f| + λ_d |∇f·d| + ε, kept away from zero: ln 0 would be infinite.
fn spread<R: Real>(options: &Options<R>, ray: &WarpedRay<'_, R>, i: usize) -> R {
    let facing = ray.gradient[i].dot(ray.direction).abs();
    (ray.f[i].abs() + options.lambda_d * facing + options.epsilon).max(R::min_positive_value())
}

impl<R: Real> Weighting<R> for Options<R> {
    fn log_density(&self, ray: &WarpedRay<'_, R>, i: usize) -> R {
        -self.gamma * spread(self, ray, i).ln()
    }

    fn log_density_rate(&self, ray: &WarpedRay<'_, R>, i: usize, motion: &Motion<R>) -> R {
        let sign = |v: R| if v < R::zero() { -R::one() } else { R::one() };
        let f_rate = ray.gradient[i].dot(motion.x);
        let facing_rate =
            motion.gradient.dot(ray.direction) + ray.gradient[i].dot(motion.direction);
        let facing_sign = sign(ray.gradient[i].dot(ray.direction));
        let spread_rate = sign(ray.f[i]) * f_rate + self.lambda_d * facing_sign * facing_rate;
        -(self.gamma * spread_rate / spread(self, ray, i))
    }
}
