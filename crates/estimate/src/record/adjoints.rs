//! The result of reverse mode: coefficients of f and ∇f at points.

use field::{Field, Real, Vector3};

/// A point at which the parameter gradient of α f + c·∇f is wanted.
#[derive(Clone, Copy, Debug)]
pub struct PointAdjoint<R: Real> {
    /// The pixel that the coefficients belong to, by its number in the batch.
    pub pixel: u32,
    /// The point, world units.
    pub x: R::Vec3,
    /// α: the coefficient of f.
    pub alpha: R,
    /// c: the coefficient of ∇f.
    pub c: R::Vec3,
}

impl<R: Real> PointAdjoint<R> {
    /// Whether both coefficients are zero.
    pub fn is_zero(&self) -> bool {
        self.alpha == R::zero() && self.c == R::Vec3::zero()
    }
}

/// Points whose parameter gradients are to be added up.
#[derive(Clone, Debug)]
pub struct Adjoints<R: Real> {
    /// The points.
    pub points: Vec<PointAdjoint<R>>,
}

impl<R: Real> Default for Adjoints<R> {
    fn default() -> Self {
        Adjoints { points: Vec::new() }
    }
}

impl<R: Real> Adjoints<R> {
    /// Adds a point.
    pub fn push(&mut self, point: PointAdjoint<R>) {
        self.points.push(point);
    }

    /// Adds the parameter gradient of all points to `sum`, in one pass over those whose
    /// coefficients are not both zero.
    pub fn backward(self, field: &dyn Field<R>, sum: &mut [R]) {
        let points: Vec<_> = self.points.into_iter().filter(|p| !p.is_zero()).collect();
        let x: Vec<R::Vec3> = points.iter().map(|p| p.x).collect();
        let alpha: Vec<R> = points.iter().map(|p| p.alpha).collect();
        let c: Vec<R::Vec3> = points.iter().map(|p| p.c).collect();
        field.parameter_vjp(&x, &alpha, &c, sum);
    }
}
