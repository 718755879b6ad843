//! Derivatives of where rays enter a ball and hit a surface.

use field::{Real, Sphere, Vector3};

use crate::Ray;

/// ∂t of the ray's entry into the ball as its direction moves along `direction_dot` (orthogonal to
/// the direction).
///
/// Zero for a ray that starts inside the ball: its start does not move.
pub fn entry_derivative<R: Real>(ray: &Ray<R>, bounds: &Sphere<R>, direction_dot: R::Vec3) -> R {
    crossing_derivative(ray, bounds, direction_dot, ray.near)
}

/// ∂t of the ray's exit from the ball as its direction moves along `direction_dot`.
pub fn exit_derivative<R: Real>(ray: &Ray<R>, bounds: &Sphere<R>, direction_dot: R::Vec3) -> R {
    crossing_derivative(ray, bounds, direction_dot, ray.far)
}

/// From |o + t d − c|² = r²: ∂t = −t (x − c)·∂d/((x − c)·d), for an end of the interval that is on
/// the sphere.
fn crossing_derivative<R: Real>(
    ray: &Ray<R>,
    bounds: &Sphere<R>,
    direction_dot: R::Vec3,
    t: R,
) -> R {
    let out = ray.at(t) - bounds.center;
    let off = (out.length() - bounds.radius).abs() > bounds.radius * R::epsilon().sqrt();
    let slope = out.dot(ray.direction);
    if off || slope == R::zero() { R::zero() } else { -t * out.dot(direction_dot) / slope }
}

/// ∂x of a hit at distance `t`, where ∇f is `gradient`, as the direction moves along
/// `direction_dot`: the point stays on the surface, ∂x = t ∂d + d ∂t with ∂t = −t (∇f·∂d)/(∇f·d).
pub fn hit_film_derivative<R: Real>(
    gradient: R::Vec3,
    direction: R::Vec3,
    t: R,
    direction_dot: R::Vec3,
) -> R::Vec3 {
    let t_dot = -t * gradient.dot(direction_dot) / facing(gradient, direction);
    direction_dot * t + direction * t_dot
}

/// ∇f·d, kept below zero: a hit comes from outside, and an exactly tangent one has no derivative.
/// At 1e-4 of |∇f| the band where this differs from ∇f·d is 5e-9 of a sphere's disc.
fn facing<R: Real>(gradient: R::Vec3, direction: R::Vec3) -> R {
    gradient.dot(direction).min(-gradient.length() * R::of(1e-4)).min(-R::min_positive_value())
}

/// What a field has to be asked for at a hit, in reverse mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HitAdjoint<R: Real> {
    /// The coefficient α of f.
    pub alpha: R,
    /// The coefficient c of ∇f.
    pub c: R::Vec3,
}

impl<R: Real> HitAdjoint<R> {
    /// The coefficient of ∇f for an adjoint `normal_bar` of the unit normal n: m = (I − n nᵀ)
    /// n̄/|∇f|.
    ///
    /// [`hit_vjp`] needs the Hessian times it.
    pub fn normal_coefficient(gradient: R::Vec3, normal_bar: R::Vec3) -> R::Vec3 {
        let inverse = R::one() / gradient.length().max(R::min_positive_value());
        let n = gradient * inverse;
        (normal_bar - n * n.dot(normal_bar)) * inverse
    }
}

/// VJP of parameters ↦ hit point and unit normal, at a hit with ∇f = `gradient`.
///
/// `point_bar` is x̂ = x̄ + ∇²f m: the adjoint of the hit point, with what the normal's dependence
/// on the point adds; `m` is [`HitAdjoint::normal_coefficient`]. The point slides along the ray by
/// −ḟ/(∇f·d), so α = −(x̂·d)/(∇f·d) and c = m, for `Field::parameter_vjp` at the hit point.
pub fn hit_vjp<R: Real>(
    gradient: R::Vec3,
    direction: R::Vec3,
    point_bar: R::Vec3,
    m: R::Vec3,
) -> HitAdjoint<R> {
    HitAdjoint { alpha: -point_bar.dot(direction) / facing(gradient, direction), c: m }
}
