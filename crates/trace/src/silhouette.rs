//! Silhouette points: rays of a family that touch a surface.

mod family;
mod minimum;
mod search;

use field::{Field, Real, Vector3};

pub use family::{RayFamily, Start, Tangency};

use minimum::RayPoint;
use search::{Search, SearchStep};

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
