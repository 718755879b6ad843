//! Fields and a shader for the checks of extremes.

use field::Shader;
use field::{Field, Real, Sphere, SurfaceAdjoint, SurfaceBatch, Vector3};

/// Radiance 1 everywhere.
pub(crate) struct White;

impl<R: Real> Shader<R> for White {
    fn parameter_count(&self) -> usize {
        0
    }
    fn radiance(&self, _: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]) {
        rgb.fill(R::Vec3::new(R::one(), R::one(), R::one()));
    }
    fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        _: &[R::Vec3],
        bars: &mut SurfaceAdjoint<R>,
        _: &mut [R],
    ) {
        *bars = SurfaceAdjoint::zeros(points.len());
    }
}

/// A field times a factor, with a NaN where z is below a height.
pub(crate) struct Altered<R: Real> {
    pub(crate) inner: Box<dyn Field<R>>,
    pub(crate) factor: f64,
    pub(crate) nan_below: f64,
}

impl<R: Real> Altered<R> {
    /// The factor at a point.
    fn factor_at(&self, x: &R::Vec3) -> R {
        if x.to_double().z < self.nan_below { R::nan() } else { R::of(self.factor) }
    }
}

impl<R: Real> Field<R> for Altered<R> {
    fn parameter_count(&self) -> usize {
        self.inner.parameter_count()
    }
    fn bounds(&self) -> Option<Sphere<R>> {
        self.inner.bounds()
    }
    fn value(&self, x: &[R::Vec3], f: &mut [R]) {
        self.inner.value(x, f);
        f.iter_mut().zip(x).for_each(|(f, x)| *f *= self.factor_at(x));
    }
    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], g: &mut [R::Vec3]) {
        self.inner.value_gradient(x, f, g);
        f.iter_mut().zip(x).for_each(|(f, x)| *f *= self.factor_at(x));
        g.iter_mut().zip(x).for_each(|(g, x)| *g = *g * self.factor_at(x));
    }
    fn hessian_vector(&self, x: &[R::Vec3], p: &[R::Vec3], g: &mut [R::Vec3], h: &mut [R::Vec3]) {
        self.inner.hessian_vector(x, p, g, h);
        g.iter_mut().chain(h).for_each(|v| *v = *v * R::of(self.factor));
    }
    fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]) {
        let alpha: Vec<R> = alpha.iter().map(|a| *a * R::of(self.factor)).collect();
        let c: Vec<R::Vec3> = c.iter().map(|c| *c * R::of(self.factor)).collect();
        self.inner.parameter_vjp(x, &alpha, &c, adjoint);
    }
}

/// f is the same number everywhere.
pub(crate) struct Constant(pub(crate) f64);

impl<R: Real> Field<R> for Constant {
    fn parameter_count(&self) -> usize {
        4
    }
    fn bounds(&self) -> Option<Sphere<R>> {
        None
    }
    fn value(&self, _: &[R::Vec3], f: &mut [R]) {
        f.fill(R::of(self.0));
    }
    fn value_gradient(&self, _: &[R::Vec3], f: &mut [R], g: &mut [R::Vec3]) {
        f.fill(R::of(self.0));
        g.fill(R::Vec3::zero());
    }
    fn hessian_vector(&self, _: &[R::Vec3], _: &[R::Vec3], g: &mut [R::Vec3], h: &mut [R::Vec3]) {
        g.fill(R::Vec3::zero());
        h.fill(R::Vec3::zero());
    }
    fn parameter_vjp(&self, _: &[R::Vec3], _: &[R], _: &[R::Vec3], _: &mut [R]) {}
}
