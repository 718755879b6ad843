//! Silhouette points: rays of a family that touch a surface.

mod minimum;
mod search;

use field::{Field, Real, Vector3};

use minimum::RayPoint;
use search::{Search, SearchStep};

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

/// Finds the silhouette near every start. Returns one element per start, `None` where the search
/// leaves its range, finds no minimum, or meets a value that is not finite.
///
/// `tolerance` is that of s, in the units of s. The search is Newton's method on m(s) = min_t f,
/// whose derivative is ∂f/∂s at the minimum (envelope theorem), kept within a bracket of the signs
/// of m. It costs values with gradients only, in batches over all searches: at most 40 along each
/// of at most 25 rays, and about three along each of three or four rays where f is smooth.
///
/// Guarantees that |f| at the minimum is at most `tolerance` times `slope`, to first order. Does
/// not guarantee that the point is visible from the origin.
pub fn tangencies<R: Real>(
    field: &(impl Field<R> + ?Sized),
    family: &(impl RayFamily<R> + ?Sized),
    starts: &[Start<R>],
    tolerance: R,
) -> Vec<Option<Tangency<R>>> {
    let mut out = vec![None; starts.len()];
    let mut searches: Vec<Search<R>> = starts
        .iter()
        .enumerate()
        .map(|(index, start)| Search::new(family, index, *start))
        .collect();
    // The unfinished searches. Their numbers are removed; the searches are too large to be moved.
    let mut active: Vec<usize> = (0..starts.len()).collect();
    let (mut x, mut f, mut gradient) =
        (Vec::new(), vec![R::zero(); starts.len()], vec![R::Vec3::zero(); starts.len()]);
    while !active.is_empty() {
        x.clear();
        x.extend(active.iter().map(|i| {
            let search = &searches[*i];
            family.origin(*i) + search.direction * search.t
        }));
        let (f, gradient) = (&mut f[..x.len()], &mut gradient[..x.len()]);
        field.value_gradient(&x, f, gradient);
        let mut values = f.iter().zip(gradient.iter());
        active.retain(|i| {
            let search = &mut searches[*i];
            let Some((&f, &gradient)) = values.next() else { return false };
            let point =
                RayPoint { t: search.t, f, slope: gradient.dot(search.direction), gradient };
            match search.take_value(family, point, tolerance) {
                SearchStep::Evaluate => true,
                SearchStep::Found(tangency) => {
                    out[*i] = Some(tangency);
                    false
                }
                SearchStep::Failed => false,
            }
        });
    }
    out
}
