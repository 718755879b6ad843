//! Derivatives of the points where rays enter a ball, leave it, and hit a surface.

use field::{Real, Sphere, Vector3};

use crate::ray::Ray;

/// JVP of direction ↦ `near`, the distance of the ray's entry into the ball `bounds`.
///
/// `direction_dot` is the tangent of the direction, orthogonal to it. The result is in world units
/// per unit of the tangent. It is 0 for a ray that starts inside the ball: its start does not move.
pub fn entry_derivative<R: Real>(ray: &Ray<R>, bounds: &Sphere<R>, direction_dot: R::Vec3) -> R {
    crossing_derivative(ray, bounds, direction_dot, ray.near)
}

/// JVP of direction ↦ `far`, the distance of the ray's exit from the ball `bounds`; see
/// [`entry_derivative`].
pub fn exit_derivative<R: Real>(ray: &Ray<R>, bounds: &Sphere<R>, direction_dot: R::Vec3) -> R {
    crossing_derivative(ray, bounds, direction_dot, ray.far)
}

/// ∂t at an end `t` of the interval: |o + t d − c|² = r² gives ∂t = −t (x − c)·∂d/((x − c)·d). Zero
/// if the end is not on the sphere.
fn crossing_derivative<R: Real>(
    ray: &Ray<R>,
    bounds: &Sphere<R>,
    direction_dot: R::Vec3,
    t: R,
) -> R {
    let from_center = ray.at(t) - bounds.center;
    let off = (from_center.length() - bounds.radius).abs() > bounds.radius * R::epsilon().sqrt();
    let slope = from_center.dot(ray.direction);
    if off || slope == R::zero() { R::zero() } else { -t * from_center.dot(direction_dot) / slope }
}

/// JVP of direction ↦ hit point, at a hit at distance `t` with ∇f = `gradient`.
///
/// `direction_dot` is the tangent ∂d of the direction. The point stays on the surface:
/// ∂x = t ∂d + d ∂t with ∂t = −t (∇f·∂d)/(∇f·d).
pub fn hit_film_derivative<R: Real>(
    gradient: R::Vec3,
    direction: R::Vec3,
    t: R,
    direction_dot: R::Vec3,
) -> R::Vec3 {
    let t_dot = -t * gradient.dot(direction_dot) / facing(gradient, direction);
    direction_dot * t + direction * t_dot
}

/// Smallest cosine between the reversed ray and ∇f in derivatives of a hit. On a sphere seen from
/// afar, the band of rays below it is 5e-9 of the radius wide.
const MIN_COSINE: f64 = 1e-4;

/// ∇f·d, kept below zero. At a hit from outside it is negative; a tangent hit has no derivative.
fn facing<R: Real>(gradient: R::Vec3, direction: R::Vec3) -> R {
    let limit = -gradient.length() * R::of(MIN_COSINE);
    gradient.dot(direction).min(limit).min(-R::min_positive_value())
}

/// Coefficients of the parameter gradient ∂_θ(α f + c·∇f) at a hit, for `Field::parameter_vjp`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HitAdjoint<R: Real> {
    /// The coefficient α of f.
    pub alpha: R,
    /// The coefficient c of ∇f.
    pub c: R::Vec3,
}

impl<R: Real> HitAdjoint<R> {
    /// VJP of ∇f ↦ unit normal n = ∇f/|∇f|: m = (I − n nᵀ) n̄/|∇f| for the adjoint
    /// n̄ = `normal_bar`.
    ///
    /// [`hit_vjp`] takes m, and the Hessian of f times m.
    pub fn normal_coefficient(gradient: R::Vec3, normal_bar: R::Vec3) -> R::Vec3 {
        let inverse = R::one() / gradient.length().max(R::min_positive_value());
        let n = gradient * inverse;
        (normal_bar - n * n.dot(normal_bar)) * inverse
    }
}

/// VJP of parameters ↦ (hit point, unit normal), at a hit with ∇f = `gradient`.
///
/// `point_bar` is x̂ = x̄ + ∇²f m: the adjoint x̄ of the hit point plus the term of the normal,
/// which depends on the point. `m` is [`HitAdjoint::normal_coefficient`]. A change ḟ of f moves
/// the point along the ray by −ḟ/(∇f·d), so α = −(x̂·d)/(∇f·d) and c = m. Pass both to
/// `Field::parameter_vjp` at the hit point.
pub fn hit_vjp<R: Real>(
    gradient: R::Vec3,
    direction: R::Vec3,
    point_bar: R::Vec3,
    m: R::Vec3,
) -> HitAdjoint<R> {
    HitAdjoint { alpha: -point_bar.dot(direction) / facing(gradient, direction), c: m }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use glam::DVec3;

    const BALL: Sphere<f64> = Sphere { center: DVec3::new(0.5, -1.0, 0.25), radius: 2.0 };

    #[test]
    fn entry_and_exit_follow_the_ball() {
        let origin = DVec3::new(0.7, -0.4, 5.0);
        let direction = DVec3::new(0.05, -0.1, -1.0).normalize();
        for tangent in [DVec3::X, DVec3::Y, DVec3::new(0.3, -2.0, 0.5)] {
            let dot = tangent.reject_from_normalized(direction);
            let at = |h: f64| Ray::enter(origin, (direction + h * dot).normalize(), &BALL);
            let (Some(here), Some(plus), Some(minus)) = (at(0.0), at(1e-5), at(-1e-5)) else {
                panic!("the rays meet the ball")
            };
            let entry = (plus.near - minus.near) / 2e-5;
            let exit = (plus.far - minus.far) / 2e-5;
            assert_relative_eq!(entry_derivative(&here, &BALL, dot), entry, epsilon = 1e-6);
            assert_relative_eq!(exit_derivative(&here, &BALL, dot), exit, epsilon = 1e-6);
        }
    }

    #[test]
    fn an_end_that_is_not_on_the_sphere_does_not_move() {
        let direction = -DVec3::Z;
        let ray = Ray::enter(BALL.center + DVec3::X, direction, &BALL);
        let ray = ray.unwrap_or_else(|| panic!("the ray starts in the ball"));
        assert_eq!(ray.near, 0.0);
        assert_eq!(entry_derivative(&ray, &BALL, DVec3::X), 0.0);
        // The exit at √3 below: −t (x − c)·∂d/((x − c)·d) with (x − c)·∂d = 1.
        let exit = exit_derivative(&ray, &BALL, DVec3::X);
        assert_relative_eq!(exit, -1.0, epsilon = 1e-12);
        let cut = Ray { far: 1.0, ..ray };
        assert_eq!(exit_derivative(&cut, &BALL, DVec3::X), 0.0);
    }

    /// A plane with the normal (0, 3, 4)/5, hit at distance 2 by a ray along −z.
    #[test]
    fn a_hit_moves_along_its_plane() {
        let gradient = DVec3::new(0.0, 3.0, 4.0);
        let moved = hit_film_derivative::<f64>(gradient, -DVec3::Z, 2.0, DVec3::Y);
        assert_relative_eq!(moved.distance(DVec3::new(0.0, 2.0, -1.5)), 0.0, epsilon = 1e-12);
        let aside = hit_film_derivative::<f64>(gradient, -DVec3::Z, 2.0, DVec3::X);
        assert_relative_eq!(aside.distance(DVec3::new(2.0, 0.0, 0.0)), 0.0, epsilon = 1e-12);
    }

    /// If f grows by 1, that hit moves along the ray by 1/4; a normal's adjoint counts across it.
    #[test]
    fn adjoints_of_a_hit_on_a_plane_are_exact() {
        let gradient = DVec3::new(0.0, 3.0, 4.0);
        let m = HitAdjoint::<f64>::normal_coefficient(gradient, DVec3::new(7.0, 5.0, 0.0));
        // (I − n nᵀ)(7, 5, 0) = (7, 5, 0) − 3 (0, 0.6, 0.8), by the length 5.
        assert_relative_eq!(m.distance(DVec3::new(1.4, 0.64, -0.48)), 0.0, epsilon = 1e-12);
        let adjoint = hit_vjp::<f64>(gradient, -DVec3::Z, DVec3::new(9.0, 9.0, 2.0), m);
        assert_eq!((adjoint.alpha, adjoint.c), (-0.5, m));
    }

    #[test]
    fn a_tangent_hit_has_finite_derivatives() {
        // ∇f·d counts as −1e-4 |∇f| at least.
        let moved = hit_film_derivative::<f64>(DVec3::Y * 2.0, -DVec3::Z, 3.0, DVec3::Y);
        let expected = DVec3::new(0.0, 3.0, -3.0 / MIN_COSINE);
        assert_relative_eq!(moved.distance(expected), 0.0, epsilon = 1e-6);
        assert!(hit_film_derivative::<f64>(DVec3::ZERO, -DVec3::Z, 3.0, DVec3::Y).is_finite());
    }
}
