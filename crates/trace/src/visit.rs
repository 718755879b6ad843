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
