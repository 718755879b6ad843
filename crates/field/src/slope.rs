//! The slope that a field is seen to have.

use random::{Name, Stream};

use crate::field::Field;
use crate::real::{Real, Vector3};
use crate::sphere::Sphere;

/// The quantile of |∇f| that counts as the slope of a field. The largest of the sampled slopes can
/// be a spike that no ray meets.
const QUANTILE: f64 = 0.98;

/// Slopes up to this one are left to the tracer, which learns slopes along each ray.
const LEARNED: f64 = 1.5;

const SLOPES: Name = Name::new("points at which slopes are measured", 23);

/// Points of [`slope`] that are enough for one scene: a few thousandths of an image's evaluations.
pub const SLOPE_POINTS: u64 = 4096;

/// The 98 % quantile of |∇f| over `points` random points of a ball, per world unit, and at least 1:
/// 1 also for slopes up to 1.5.
///
/// It costs nothing for a field that is known to be Lipschitz. The points are the same at every
/// call. Points whose gradient is not finite are left out.
///
/// It is [`slope_of`] the gradients at the [`slope_places`], which threads can share.
pub fn slope<R: Real>(field: &dyn Field<R>, ball: &Sphere<R>, points: u64) -> R {
    if field.is_lipschitz() {
        return R::one();
    }
    let x = slope_places(ball, points);
    let (mut f, mut gradient) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
    field.value_gradient(&x, &mut f, &mut gradient);
    slope_of::<R>(&gradient)
}

/// The places of a ball at which [`slope`] measures, in world units.
pub fn slope_places<R: Real>(ball: &Sphere<R>, points: u64) -> Vec<R::Vec3> {
    let stream = Stream::of_seed(0).named(SLOPES);
    let place = |i: u64| {
        let unit = stream.at(i).in_ball().map(R::of);
        ball.center + R::Vec3::from_array(unit) * ball.radius
    };
    (0..points).map(place).collect()
}

/// The [`slope`] of a field with these gradients.
pub fn slope_of<R: Real>(gradients: &[R::Vec3]) -> R {
    let mut slopes: Vec<f64> = gradients
        .iter()
        .map(|g| g.length().to_double())
        .filter(|slope| slope.is_finite())
        .collect();
    if slopes.is_empty() {
        return R::one();
    }
    let at = ((slopes.len() - 1) as f64 * QUANTILE) as usize;
    let (_, slope, _) = slopes.select_nth_unstable_by(at, f64::total_cmp);
    if *slope > LEARNED { R::of(*slope) } else { R::one() }
}
