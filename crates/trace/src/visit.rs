//! The record T(u) of plain sphere tracing, from which warp fields are built.

use field::{Field, Real, Vector3};

use crate::ray::Ray;

/// The visited points of a batch of rays: at most N points per ray.
///
/// Every quantity of the points has a vector of its own, because the crate `warp` reads slices and
/// does not depend on this crate.
#[derive(Clone, Debug, Default)]
pub struct Visits<R: Real> {
    /// N: the number of slots per ray.
    points: usize,
    /// One element per ray.
    records: Vec<RecordEnd>,
    t: Vec<R>,
    f: Vec<R>,
    gradient: Vec<R::Vec3>,
    step: Vec<R>,
}

/// The end of the record of one ray.
#[derive(Clone, Copy, Debug)]
struct RecordEnd {
    /// The number of filled slots.
    count: usize,
    /// See [`Visited::clamped`].
    clamped: bool,
    /// See [`Visited::valid`].
    valid: bool,
}

/// The visited points of one ray, in order. The slices have one length, at most N.
#[derive(Clone, Copy, Debug)]
pub struct Visited<'a, R: Real> {
    /// Distances along the ray, in world units.
    pub t: &'a [R],
    /// f at the points.
    pub f: &'a [R],
    /// ∇f at the points.
    pub gradient: &'a [R::Vec3],
    /// Δ: the length of the ray that each point stands for, in world units. This is |ρ f|, cut off
    /// at the end of the interval.
    pub step: &'a [R],
    /// Whether the last point's step was cut off at the end of the interval.
    pub clamped: bool,
    /// Whether f and ∇f were finite everywhere. If not, the record ends before the first point with
    /// a NaN or an infinity.
    pub valid: bool,
}

impl<R: Real> Visits<R> {
    /// The points of ray `i`.
    ///
    /// # Panics
    /// If there is no ray `i`.
    pub fn ray(&self, i: usize) -> Visited<'_, R> {
        let RecordEnd { count, clamped, valid } = self.records[i];
        let span = i * self.points..i * self.points + count;
        Visited {
            t: &self.t[span.clone()],
            f: &self.f[span.clone()],
            gradient: &self.gradient[span.clone()],
            step: &self.step[span],
            clamped,
            valid,
        }
    }

    /// The number of rays.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Whether there are no rays.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }
}

/// Records the recursion t ← t + ρ f(x(t)) from `Ray::near`, with f and ∇f at each point: N =
/// `points` points per ray, and ρ = `relaxation`.
///
/// This is sphere tracing (Hart, "Sphere Tracing: A Geometric Method for the Antialiased Ray
/// Tracing of Implicit Surfaces", The Visual Computer 12, 1996) with a fixed number of points and
/// no hit test. The N points are the quadrature points of the published warp field (Bangaru et al.,
/// "Differentiable Rendering of Neural SDFs through Reparameterization", SIGGRAPH Asia 2022).
///
/// A record has fewer points if the interval ends before, if f or ∇f is not finite, or if the
/// recursion stands still: every further point would be the same.
pub fn visit<R: Real>(
    field: &(impl Field<R> + ?Sized),
    rays: &[Ray<R>],
    points: usize,
    relaxation: R,
) -> Visits<R> {
    let slots = rays.len() * points;
    let mut v = Visits {
        points,
        records: vec![RecordEnd { count: 0, clamped: false, valid: true }; rays.len()],
        t: vec![R::zero(); slots],
        f: vec![R::zero(); slots],
        gradient: vec![R::Vec3::zero(); slots],
        step: vec![R::zero(); slots],
    };
    let mut active: Vec<(usize, R)> = rays.iter().map(|r| r.near).enumerate().collect();
    let mut x = Vec::with_capacity(rays.len());
    let (mut f, mut gradient) = (vec![R::zero(); rays.len()], vec![R::Vec3::zero(); rays.len()]);
    for index in 0..points {
        x.clear();
        x.extend(active.iter().map(|(ray, t)| rays[*ray].at(*t)));
        let (f, gradient) = (&mut f[..x.len()], &mut gradient[..x.len()]);
        field.value_gradient(&x, f, gradient);
        let mut values = f.iter().zip(gradient.iter());
        active.retain_mut(|(ray, t)| {
            let Some((f, gradient)) = values.next() else { return false };
            let left = (rays[*ray].far - *t).max(R::zero());
            let next = v.record([*ray, index], (*t, *f, *gradient), left, relaxation);
            next.is_some_and(|next| {
                let moves = next != *t;
                *t = next;
                moves
            })
        });
        if active.is_empty() {
            break;
        }
    }
    v
}

impl<R: Real> Visits<R> {
    /// Stores a point of a ray, with t, f and ∇f, and the rest `left` of the interval behind it.
    /// Returns the distance of the next point, if the ray goes on.
    fn record(
        &mut self,
        [ray, index]: [usize; 2],
        (t, f, gradient): (R, R, R::Vec3),
        left: R,
        relaxation: R,
    ) -> Option<R> {
        let record = &mut self.records[ray];
        if !f.is_finite() || !gradient.is_finite() {
            record.valid = false;
            return None;
        }
        let step = relaxation * f;
        (record.count, record.clamped) = (index + 1, step >= left);
        let slot = ray * self.points + index;
        (self.t[slot], self.f[slot], self.gradient[slot]) = (t, f, gradient);
        self.step[slot] = step.abs().min(left);
        (step < left).then_some(t + step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use field::{Kind, Shape};
    use glam::DVec3;

    fn ray(origin: DVec3) -> Ray<f64> {
        Ray {
            origin,
            direction: -DVec3::Z,
            near: 1.0,
            far: 6.0,
            scale: 1.0,
            spread: 0.0,
            reach: f64::INFINITY,
        }
    }

    /// The half space z ≤ 0, seen from z = 5: with ρ = 1 the second point is the root, where the
    /// recursion stands still. With ρ = 1/2 each step halves the rest.
    #[test]
    fn steps_towards_a_plane_shrink_geometrically() {
        let plane = Shape::<f64>::new(Kind::Plane, &[0.0, 0.0, 1.0, 0.0]);
        let rays = [ray(DVec3::new(0.0, 0.0, 5.0))];
        let whole = visit(&plane, &rays, 10, 1.0);
        assert_eq!((whole.ray(0).t, whole.ray(0).f), (&[1.0, 5.0][..], &[4.0, 0.0][..]));
        assert_eq!((whole.ray(0).step, whole.ray(0).clamped), (&[4.0, 0.0][..], false));
        assert!(whole.ray(0).valid && whole.ray(0).gradient.iter().all(|g| *g == DVec3::Z));
        let half = visit(&plane, &rays, 10, 0.5);
        let v = half.ray(0);
        assert_eq!(v.t.len(), 10);
        for (i, rest) in (0..10).map(|i| (i as usize, 4.0 * 0.5f64.powi(i))) {
            assert_relative_eq!(v.t[i], 5.0 - rest, epsilon = 1e-12);
            assert_relative_eq!(v.f[i], rest, epsilon = 1e-12);
            assert_relative_eq!(v.step[i], 0.5 * rest, epsilon = 1e-12);
        }
    }

    /// A ray that moves away from a plane: f = 1, 2, 4 at t = 1, 2, 4. Of the last 4, 2 are left.
    #[test]
    fn the_last_step_is_cut_off_at_the_end_of_the_interval() {
        let plane = Shape::<f64>::new(Kind::Plane, &[0.0, 0.0, -1.0, 0.0]);
        let rays = [ray(DVec3::ZERO), ray(DVec3::new(0.0, 0.0, 9.0))];
        let visits = visit(&plane, &rays, 10, 1.0);
        assert_eq!((visits.len(), visits.is_empty()), (2, false));
        let v = visits.ray(0);
        assert_eq!((v.t, v.step), (&[1.0, 2.0, 4.0][..], &[1.0, 2.0, 2.0][..]));
        assert!(v.clamped && v.valid);
        // Inside of the solid f is negative, and the recursion goes back: lengths are positive.
        let v = visits.ray(1);
        assert_eq!((v.t[0], v.f[0], v.t[1]), (1.0, -8.0, -7.0));
        assert_eq!(v.step[0], 5.0);
        assert!(!v.clamped);
        let none = visit(&plane, &[], 10, 1.0);
        assert_eq!((none.len(), none.is_empty()), (0, true));
    }

    #[test]
    fn a_record_ends_before_a_number_that_is_not_finite() {
        let plane = Shape::<f64>::new(Kind::Plane, &[0.0, 0.0, 1.0, 0.0]);
        let nan = Shape::<f64>::new(Kind::Plane, &[0.0, 0.0, f64::NAN, 0.0]);
        let good = [ray(DVec3::new(0.0, 0.0, 5.0))];
        let v = visit(&nan, &good, 4, 1.0);
        assert_eq!((v.ray(0).t.len(), v.ray(0).valid), (0, false));
        let infinite = [ray(DVec3::new(0.0, 0.0, f64::INFINITY)), good[0]];
        let v = visit(&plane, &infinite, 4, 1.0);
        assert_eq!((v.ray(0).t.len(), v.ray(0).valid), (0, false));
        assert_eq!((v.ray(1).t.len(), v.ray(1).valid), (2, true));
    }
}
