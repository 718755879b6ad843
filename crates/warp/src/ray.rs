//! What the warp reads: a chart of the film, and the record of a ray.

use field::{Real, Vector3};

/// The chart between world and film: u = projection of x, in pixels.
pub trait Projection<R: Real> {
    /// The rows ∂u_x/∂x and ∂u_y/∂x, in pixels per world unit.
    fn jacobian(&self, x: R::Vec3) -> [R::Vec3; 2];
    /// The change of those rows as the point moves along `dx`.
    fn jacobian_derivative(&self, x: R::Vec3, dx: R::Vec3) -> [R::Vec3; 2];
}

/// A ray with the points that the tracer's recursion visited, and how it moves with the film
/// position.
///
/// The slices have one length, and one element a point: t_{i+1} = t_i + ρ f_i.
#[derive(Clone, Copy, Debug)]
pub struct WarpedRay<'a, R: Real> {
    /// o, the same for all film positions.
    pub origin: R::Vec3,
    /// d, of length 1.
    pub direction: R::Vec3,
    /// ∂d/∂u_x and ∂d/∂u_y, per pixel.
    pub direction_du: [R::Vec3; 2],
    /// ∂t_0/∂u: of where the recursion starts, world units per pixel.
    pub entry_du: [R; 2],
    /// ∂t/∂u of the interval's end, used where the last step was cut off there.
    pub exit_du: [R; 2],
    /// Distances of the points.
    pub t: &'a [R],
    /// f at the points.
    pub f: &'a [R],
    /// ∇f at the points.
    pub gradient: &'a [R::Vec3],
    /// Δ at the points, |ρ f| or what is left of the interval; 0 or more.
    pub step: &'a [R],
    /// Whether the last Δ was cut off at the interval's end.
    pub clamped: bool,
    /// Whether the record is free of NaNs; what is here is checked again.
    pub valid: bool,
}

impl<R: Real> WarpedRay<'_, R> {
    pub(crate) fn x(&self, i: usize) -> R::Vec3 {
        self.origin + self.direction * self.t[i]
    }

    /// Whether the length of point `i` ends with the interval, and not with the step.
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
