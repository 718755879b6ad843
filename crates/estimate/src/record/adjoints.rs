//! The result of reverse mode: coefficients of f and ∇f at points, for one pass over the
//! parameters.

use field::{Field, Real, Vector3};

use crate::record::cameras::CameraAdjoints;

/// A point x with coefficients α and c: its part of a parameter gradient is ∂_θ [α f(x) + c·∇f(x)].
#[derive(Clone, Copy, Debug)]
pub struct PointAdjoint<R: Real> {
    /// The point, in world units.
    pub x: R::Vec3,
    /// α: the coefficient of f, in units of the differentiated number per world unit.
    pub alpha: R,
    /// c: the coefficient of ∇f, in units of the differentiated number.
    pub c: R::Vec3,
}

impl<R: Real> PointAdjoint<R> {
    /// Whether both coefficients are zero.
    pub fn is_zero(&self) -> bool {
        self.alpha == R::zero() && self.c == R::Vec3::zero()
    }
}

/// The adjoint of a point that a sample of a pixel gives.
#[derive(Clone, Copy, Debug)]
pub struct PixelAdjoint<R: Real> {
    /// The pixel that the coefficients belong to, by its number in the batch.
    pub pixel: u32,
    /// The point with its coefficients.
    pub point: PointAdjoint<R>,
}

/// Points whose parts of a parameter gradient are added up.
#[derive(Clone, Debug)]
pub struct Adjoints<R: Real> {
    /// The points.
    pub points: Vec<PixelAdjoint<R>>,
    /// The adjoints of the cameras, if they are wanted.
    pub cameras: Option<CameraAdjoints>,
}

impl<R: Real> Default for Adjoints<R> {
    fn default() -> Self {
        Adjoints { points: Vec::new(), cameras: None }
    }
}

impl<R: Real> Adjoints<R> {
    /// Adds a point of a pixel, by its number in the batch.
    pub fn push(&mut self, pixel: u32, point: PointAdjoint<R>) {
        self.points.push(PixelAdjoint { pixel, point });
    }

    /// VJP of θ ↦ Σ (α f + c·∇f): adds the gradient by the field's parameters to `sum`.
    ///
    /// One call of `Field::parameter_vjp` over the points whose coefficients are not both zero.
    pub fn backward(self, field: &dyn Field<R>, sum: &mut [R]) {
        let (x, alpha, c) = self.columns();
        field.parameter_vjp(&x, &alpha, &c, sum);
    }

    /// The points whose coefficients are not both zero: x, α and c, as arguments of
    /// [`Field::parameter_vjp`].
    pub fn columns(self) -> (Vec<R::Vec3>, Vec<R>, Vec<R::Vec3>) {
        let points = self.points.into_iter().map(|own| own.point).filter(|point| !point.is_zero());
        let (mut x, mut alpha, mut c) = (Vec::new(), Vec::new(), Vec::new());
        for point in points {
            x.push(point.x);
            alpha.push(point.alpha);
            c.push(point.c);
        }
        (x, alpha, c)
    }
}
