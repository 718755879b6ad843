//! The record of a ray: the input of the warp.

use field::{Real, Vector3};

/// A ray with the points of the recursion t_{i+1} = t_i + ρ f_i, and its motion with the film
/// position u. The slices have one element per point.
#[derive(Clone, Copy, Debug)]
pub struct WarpedRay<'a, R: Real> {
    /// o, in world units; the same for all film positions.
    pub origin: R::Vec3,
    /// d, of length 1.
    pub direction: R::Vec3,
    /// ∂d/∂u_x and ∂d/∂u_y, per pixel.
    pub direction_du: [R::Vec3; 2],
    /// ∂t_0/∂u of the first point, in world units per pixel.
    pub entry_du: [R; 2],
    /// ∂t/∂u of the end of the interval, in world units per pixel; used if `clamped`.
    pub exit_du: [R; 2],
    /// ρ: the fraction of f that a step of the recursion took.
    pub relaxation: R,
    /// The distances of the points, in world units.
    pub t: &'a [R],
    /// f at the points.
    pub f: &'a [R],
    /// ∇f at the points.
    pub gradient: &'a [R::Vec3],
    /// Δ at the points: |ρ f|, or the rest of the interval if that is less; 0 or more.
    pub step: &'a [R],
    /// Whether the last Δ ends with the interval.
    pub clamped: bool,
    /// Whether the record has no NaN. All numbers are checked again.
    pub valid: bool,
}

impl<R: Real> WarpedRay<'_, R> {
    pub(crate) fn x(&self, i: usize) -> R::Vec3 {
        self.origin + self.direction * self.t[i]
    }

    /// Whether the length of point `i` ends with the interval instead of the step.
    pub(crate) fn is_cut_off(&self, i: usize) -> bool {
        self.clamped && i + 1 == self.t.len()
    }

    pub(crate) fn is_finite(&self) -> bool {
        let numbers = |values: &[R]| values.iter().all(|v| v.is_finite());
        let vectors = |values: &[R::Vec3]| values.iter().all(|v| v.is_finite());
        vectors(&[self.origin, self.direction])
            && vectors(&self.direction_du)
            && numbers(&self.entry_du)
            && (!self.clamped || numbers(&self.exit_du))
            && numbers(self.t)
            && numbers(self.f)
            && numbers(self.step)
            && vectors(self.gradient)
    }
}
