//! Families of rays, and the rays of them that touch a surface.

use field::Real;

/// Rays that share an origin per search, with a direction that depends on one parameter s.
///
/// Directions have length 1. The unit of s is the caller's; estimators let s be a film coordinate
/// in pixels.
pub trait RayFamily<R: Real> {
    /// The origin of the rays of search `index`.
    fn origin(&self, index: usize) -> R::Vec3;
    /// The direction of search `index` at `s`, and its derivative by s.
    fn direction(&self, index: usize, s: R) -> (R::Vec3, R::Vec3);
}

/// The start of a search: near a closest approach of f to zero along the ray at s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start<R> {
    /// The parameter of the ray.
    pub s: R,
    /// The distance along it, in world units.
    pub t: R,
    /// The smallest and the largest s of the search.
    pub range: [R; 2],
    /// The first step along the ray towards the minimum of f: about the width of the minimum, in
    /// world units.
    pub reach: R,
    /// Largest cosine between the reversed ray and ∇f at the start. A ray that meets the surface at
    /// a larger cosine has no silhouette near, and its search fails at once. 1 accepts all rays.
    pub steepest: R,
}

/// A ray that touches a surface: f = 0 at a minimum of f along the ray.
///
/// The minimum lies between two points, and `gradient` is their weighted mean. At an edge of a
/// solid, where f has a kink, it is the mean of both faces' gradients that is orthogonal to the
/// ray. Where f is smooth, it is the interpolated gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tangency<R: Real> {
    /// The parameter of the ray.
    pub s: R,
    /// The distance of the minimum along the ray.
    pub t: R,
    /// The points before and after the minimum.
    pub points: [R::Vec3; 2],
    /// Their weights: 0 or more, with sum 1.
    pub weights: [R; 2],
    /// ∇f at the minimum, orthogonal to the ray.
    pub gradient: R::Vec3,
    /// ∇f at the first of the two points: a ray just inside enters the solid with this normal.
    pub front: R::Vec3,
    /// ∂m/∂s of m(s) = min_t f, in world units per unit of s: positive where the ray leaves the
    /// solid as s grows.
    pub slope: R,
    /// Whether the two points are on different faces: `gradient` is then the normal of neither.
    pub edge: bool,
    /// The second derivative of f along the ray at the minimum, per world unit: large at an edge.
    pub bend: R,
}
