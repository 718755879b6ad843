//! The points T(u) of the plain recursion, recorded for warp fields.

use field::{Field, Real, Vector3};

use crate::Ray;

/// The visited points of a batch of rays, `stride` slots a ray.
#[derive(Clone, Debug, Default)]
pub struct Visits<R: Real> {
    stride: usize,
    count: Vec<usize>,
    valid: Vec<bool>,
    clamped: Vec<bool>,
    t: Vec<R>,
    f: Vec<R>,
    gradient: Vec<R::Vec3>,
    step: Vec<R>,
}

/// The visited points of one ray, in order.
#[derive(Clone, Copy, Debug)]
pub struct Visited<'a, R: Real> {
    /// Distances along the ray.
    pub t: &'a [R],
    /// f at the points.
    pub f: &'a [R],
    /// ∇f at the points.
    pub gradient: &'a [R::Vec3],
    /// Δ: the ray length that each point stands for, |ρ f|, cut off where the interval ends.
    pub step: &'a [R],
    /// Whether the last point's step was cut off at the interval's end.
    pub clamped: bool,
    /// Whether everything was finite; if not, the points before the first NaN are here.
    pub valid: bool,
}

impl<R: Real> Visits<R> {
    /// The points of ray `i`.
    pub fn ray(&self, i: usize) -> Visited<'_, R> {
        let span = i * self.stride..i * self.stride + self.count[i];
        Visited {
            t: &self.t[span.clone()],
            f: &self.f[span.clone()],
            gradient: &self.gradient[span.clone()],
            step: &self.step[span],
            clamped: self.clamped[i],
            valid: self.valid[i],
        }
    }

    /// The number of rays.
    pub fn len(&self) -> usize {
        self.count.len()
    }

    /// Whether there are no rays.
    pub fn is_empty(&self) -> bool {
        self.count.is_empty()
    }
}

/// Follows t ← t + ρ f(x(t)) from `near` for `points` points a ray, with f and ∇f at each.
///
/// A record is shorter where the interval ends before, or where the recursion stands still (every
/// further point would be the same one).
pub fn visit<R: Real>(
    field: &(impl Field<R> + ?Sized),
    rays: &[Ray<R>],
    points: usize,
    relaxation: R,
) -> Visits<R> {
    let slots = rays.len() * points;
    let mut v = Visits {
        stride: points,
        count: vec![0; rays.len()],
        valid: vec![true; rays.len()],
        clamped: vec![false; rays.len()],
        t: vec![R::zero(); slots],
        f: vec![R::zero(); slots],
        gradient: vec![R::Vec3::zero(); slots],
        step: vec![R::zero(); slots],
    };
    let mut active: Vec<(usize, R)> = rays.iter().map(|r| r.near).enumerate().collect();
    let mut x = Vec::with_capacity(rays.len());
    let (mut f, mut gradient) = (vec![R::zero(); rays.len()], vec![R::Vec3::zero(); rays.len()]);
    for point in 0..points {
        x.clear();
        x.extend(active.iter().map(|(ray, t)| rays[*ray].at(*t)));
        let (f, gradient) = (&mut f[..x.len()], &mut gradient[..x.len()]);
        field.value_gradient(&x, f, gradient);
        let mut values = f.iter().zip(gradient.iter());
        active.retain_mut(|(ray, t)| {
            let Some((f, gradient)) = values.next() else { return false };
            v.record(*ray, point, *t, *f, *gradient, rays[*ray].far, relaxation).is_some_and(
                |next| {
                    let moves = next != *t;
                    *t = next;
                    moves
                },
            )
        });
        if active.is_empty() {
            break;
        }
    }
    v
}

impl<R: Real> Visits<R> {
    /// Stores a point; returns where the next one is, if there is one.
    #[allow(clippy::too_many_arguments, reason = "a point and its ray")]
    fn record(
        &mut self,
        ray: usize,
        point: usize,
        t: R,
        f: R,
        gradient: R::Vec3,
        far: R,
        relaxation: R,
    ) -> Option<R> {
        if !f.is_finite() || !gradient.is_finite() {
            self.valid[ray] = false;
            return None;
        }
        let slot = ray * self.stride + point;
        let left = (far - t).max(R::zero());
        let step = relaxation * f;
        self.clamped[ray] = step >= left;
        self.count[ray] = point + 1;
        (self.t[slot], self.f[slot], self.gradient[slot]) = (t, f, gradient);
        self.step[slot] = step.abs().min(left);
        (!self.clamped[ray]).then_some(t + step)
    }
}
