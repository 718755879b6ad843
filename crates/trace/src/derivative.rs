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
