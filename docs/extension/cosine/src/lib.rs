//! An example of a research extension: a warp whose weights are those of Vicini, Speierer and Jakob
//! 2022, "Differentiable Signed Distance Function Rendering", along rays: ρ = (ε + |f| + λ c²)^−3
//! with the cosine c = ∇f·d/|∇f|, instead of the published S^−γ with its absolute value of ∇f·d.
//! The square makes S smooth where a ray turns away from the surface.

use warp::field::{Real, Vector3};
use warp::{Motion, WarpedRay, Weighting};

/// ε, in world units.
const EPSILON: f64 = 1e-6;

/// λ, in world units.
const LAMBDA: f64 = 0.05;

/// The exponent.
const EXPONENT: f64 = 3.0;

/// The weights.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cosine;

/// The cosine between ray and gradient, and the gradient's length.
fn cosine<R: Real>(ray: &WarpedRay<'_, R>, i: usize) -> (R, R) {
    let length = ray.gradient[i].length().max(R::min_positive_value());
    (ray.gradient[i].dot(ray.direction) / length, length)
}

/// ε + |f| + λ c².
fn spread<R: Real>(ray: &WarpedRay<'_, R>, i: usize) -> R {
    let (c, _) = cosine(ray, i);
    R::of(EPSILON) + ray.f[i].abs() + R::of(LAMBDA) * c * c
}

impl<R: Real> Weighting<R> for Cosine {
    fn log_density(&self, ray: &WarpedRay<'_, R>, i: usize) -> R {
        -R::of(EXPONENT) * spread(ray, i).ln()
    }

    fn log_density_rate(&self, ray: &WarpedRay<'_, R>, i: usize, motion: &Motion<R>) -> R {
        let ((c, length), gradient) = (cosine(ray, i), ray.gradient[i]);
        let turned = motion.gradient.dot(ray.direction) + gradient.dot(motion.direction);
        let stretched = gradient.dot(motion.gradient) / (length * length);
        let c_rate = turned / length - c * stretched;
        let f_rate =
            gradient.dot(motion.x) * if ray.f[i] < R::zero() { -R::one() } else { R::one() };
        -R::of(EXPONENT) * (f_rate + R::of(2.0 * LAMBDA) * c * c_rate) / spread(ray, i)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trace::field::{Field, Shape};

    type Vector = <f64 as Real>::Vec3;

    /// ln ρ at distance t on the ray from (0, 0, 3) towards (u, 0.2, −1), with ρ's rate as u grows.
    fn at(u: f64, t: f64) -> (f64, f64) {
        let ball = Shape::<f64>::sphere([0.1, 0.0, 0.0], 0.8);
        let raw = Vector::new(u, 0.2, -1.0);
        let (direction, size) = (raw.normalize(), raw.length());
        let along = Vector::new(1.0, 0.0, 0.0);
        let turn = (along - direction * direction.dot(along)) / size;
        let origin = Vector::new(0.0, 0.0, 3.0);
        let (x, dx) = (origin + t * direction, t * turn);
        let (mut f, mut gradient, mut again, mut product) =
            ([0.0], [Vector::zero()], [Vector::zero()], [Vector::zero()]);
        ball.value_gradient(&[x], &mut f, &mut gradient);
        ball.hessian_vector(&[x], &[dx], &mut again, &mut product);
        let ray = WarpedRay {
            origin,
            direction,
            direction_du: [turn; 2],
            entry_du: [0.0; 2],
            exit_du: [0.0; 2],
            t: &[t],
            f: &f,
            gradient: &gradient,
            step: &f,
            clamped: false,
            valid: true,
        };
        let motion = Motion { direction: turn, t: 0.0, exit: 0.0, x: dx, gradient: product[0] };
        (Cosine.log_density(&ray, 0), Cosine.log_density_rate(&ray, 0, &motion))
    }

    #[test]
    fn the_rate_is_that_of_differences() {
        for (u, t) in [(0.1, 1.5), (0.3, 2.4), (-0.2, 2.9), (0.0, 3.0)] {
            let step = 1e-6;
            let difference = (at(u + step, t).0 - at(u - step, t).0) / (2.0 * step);
            let rate = at(u, t).1;
            assert!(
                (rate - difference).abs() < 1e-6 * (1.0 + rate.abs()),
                "{u}, {t}: {rate} against {difference}"
            );
        }
    }
}
