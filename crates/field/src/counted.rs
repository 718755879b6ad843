//! Counts of field evaluations by kind.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::field::Field;
use crate::partial_sum::PartialSum;
use crate::real::Real;
use crate::sphere::Sphere;

/// The number of evaluated points, by kind of evaluation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Evaluations {
    /// Points of [`Field::value`].
    pub value: u64,
    /// Points of [`Field::value_gradient`].
    pub gradient: u64,
    /// Points of [`Field::hessian_vector`].
    pub hessian_vector: u64,
    /// Points of [`Field::parameter_vjp`] and [`Field::parameter_jvp`].
    pub parameter: u64,
}

impl std::ops::AddAssign for Evaluations {
    fn add_assign(&mut self, other: Self) {
        self.value += other.value;
        self.gradient += other.gradient;
        self.hessian_vector += other.hessian_vector;
        self.parameter += other.parameter;
    }
}

/// A field with a counter for each kind of evaluation.
///
/// All threads share the counters. [`Counted::evaluations`] reads them.
#[derive(Debug)]
pub struct Counted<F> {
    inner: F,
    value: AtomicU64,
    gradient: AtomicU64,
    hessian_vector: AtomicU64,
    parameter: AtomicU64,
}

impl<F> Counted<F> {
    /// Wraps a field; all counts are zero.
    pub fn new(inner: F) -> Self {
        let zero = || AtomicU64::new(0);
        Counted {
            inner,
            value: zero(),
            gradient: zero(),
            hessian_vector: zero(),
            parameter: zero(),
        }
    }

    /// The counts so far.
    pub fn evaluations(&self) -> Evaluations {
        Evaluations {
            value: self.value.load(Ordering::Relaxed),
            gradient: self.gradient.load(Ordering::Relaxed),
            hessian_vector: self.hessian_vector.load(Ordering::Relaxed),
            parameter: self.parameter.load(Ordering::Relaxed),
        }
    }

    /// The wrapped field.
    pub fn inner(&self) -> &F {
        &self.inner
    }

    /// The wrapped field, to change its parameters.
    pub fn inner_mut(&mut self) -> &mut F {
        &mut self.inner
    }
}

fn count(counter: &AtomicU64, points: usize) {
    counter.fetch_add(points as u64, Ordering::Relaxed);
}

impl<R: Real, F: Field<R>> Field<R> for Counted<F> {
    fn parameter_count(&self) -> usize {
        self.inner.parameter_count()
    }
    fn bounds(&self) -> Option<Sphere<R>> {
        self.inner.bounds()
    }
    fn is_lipschitz(&self) -> bool {
        self.inner.is_lipschitz()
    }
    fn has_creases(&self) -> bool {
        self.inner.has_creases()
    }
    fn faces(&self, x: &[R::Vec3], face: &mut [u32]) {
        count(&self.value, x.len());
        self.inner.faces(x, face);
    }
    fn value(&self, x: &[R::Vec3], f: &mut [R]) {
        count(&self.value, x.len());
        self.inner.value(x, f);
    }
    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]) {
        count(&self.gradient, x.len());
        self.inner.value_gradient(x, f, gradient);
    }
    fn hessian_vector(
        &self,
        x: &[R::Vec3],
        p: &[R::Vec3],
        gradient: &mut [R::Vec3],
        product: &mut [R::Vec3],
    ) {
        count(&self.hessian_vector, x.len());
        self.inner.hessian_vector(x, p, gradient, product);
    }
    fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]) {
        count(&self.parameter, x.len());
        self.inner.parameter_vjp(x, alpha, c, adjoint);
    }
    fn table(&self) -> Range<usize> {
        self.inner.table()
    }
    fn add_parameter_vjp(
        &self,
        x: &[R::Vec3],
        alpha: &[R],
        c: &[R::Vec3],
        sum: &mut PartialSum<R>,
    ) {
        count(&self.parameter, x.len());
        self.inner.add_parameter_vjp(x, alpha, c, sum);
    }
    fn parameter_jvp(&self, x: &[R::Vec3], tangent: &[R], f: &mut [R], gradient: &mut [R::Vec3]) {
        count(&self.parameter, x.len());
        self.inner.parameter_jvp(x, tangent, f, gradient);
    }
}

/// Implements [`Field`] for a pointer to a field.
macro_rules! implement_for_pointer {
    ($ty:ty) => {
        impl<R: Real, F: Field<R> + ?Sized> Field<R> for $ty {
            fn parameter_count(&self) -> usize {
                (**self).parameter_count()
            }
            fn bounds(&self) -> Option<Sphere<R>> {
                (**self).bounds()
            }
            fn is_lipschitz(&self) -> bool {
                (**self).is_lipschitz()
            }
            fn has_creases(&self) -> bool {
                (**self).has_creases()
            }
            fn faces(&self, x: &[R::Vec3], face: &mut [u32]) {
                (**self).faces(x, face);
            }
            fn value(&self, x: &[R::Vec3], f: &mut [R]) {
                (**self).value(x, f);
            }
            fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]) {
                (**self).value_gradient(x, f, gradient);
            }
            fn hessian_vector(
                &self,
                x: &[R::Vec3],
                p: &[R::Vec3],
                gradient: &mut [R::Vec3],
                product: &mut [R::Vec3],
            ) {
                (**self).hessian_vector(x, p, gradient, product);
            }
            fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]) {
                (**self).parameter_vjp(x, alpha, c, adjoint);
            }
            fn table(&self) -> Range<usize> {
                (**self).table()
            }
            fn add_parameter_vjp(
                &self,
                x: &[R::Vec3],
                alpha: &[R],
                c: &[R::Vec3],
                sum: &mut PartialSum<R>,
            ) {
                (**self).add_parameter_vjp(x, alpha, c, sum);
            }
            fn parameter_jvp(
                &self,
                x: &[R::Vec3],
                tangent: &[R],
                f: &mut [R],
                gradient: &mut [R::Vec3],
            ) {
                (**self).parameter_jvp(x, tangent, f, gradient);
            }
        }
    };
}

implement_for_pointer!(&F);
implement_for_pointer!(Box<F>);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Shape;
    use glam::DVec3;

    #[test]
    fn points_are_counted_by_kind() {
        let field = Counted::new(Shape::<f64>::sphere([0.0; 3], 1.0));
        let x = [DVec3::X, DVec3::Y, DVec3::Z];
        let (mut f, mut g, mut h) = ([0.0; 3], [DVec3::ZERO; 3], [DVec3::ZERO; 3]);
        field.value(&x, &mut f);
        field.value_gradient(&x[..2], &mut f[..2], &mut g[..2]);
        field.hessian_vector(&x[..1], &x[..1], &mut g[..1], &mut h[..1]);
        field.parameter_vjp(&x, &[0.0; 3], &x, &mut [0.0; 4]);
        let expected = Evaluations { value: 3, gradient: 2, hessian_vector: 1, parameter: 3 };
        assert_eq!(field.evaluations(), expected);
    }
}
