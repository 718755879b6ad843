//! Counting field evaluations by kind.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::{Field, Real, Sphere};

/// How many points each kind of pass has seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Evaluations {
    /// Points whose value alone was asked for.
    pub value: u64,
    /// Points whose value and gradient were asked for.
    pub gradient: u64,
    /// Hessian–vector products.
    pub hessian_vector: u64,
    /// Points of a parameter VJP or JVP.
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

/// A field that counts what is asked of it; shared by all threads, read with
/// [`Counted::evaluations`].
#[derive(Debug)]
pub struct Counted<F> {
    inner: F,
    value: AtomicU64,
    gradient: AtomicU64,
    hessian_vector: AtomicU64,
    parameter: AtomicU64,
}

impl<F> Counted<F> {
    /// Starts counting at zero.
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

    /// The field itself.
    pub fn inner(&self) -> &F {
        &self.inner
    }

    /// The field itself, to change its parameters.
    pub fn inner_mut(&mut self) -> &mut F {
        &mut self.inner
    }
}

fn add(counter: &AtomicU64, points: usize) {
    counter.fetch_add(points as u64, Ordering::Relaxed);
}

impl<R: Real, F: Field<R>> Field<R> for Counted<F> {
    fn parameter_count(&self) -> usize {
        self.inner.parameter_count()
    }
    fn bounds(&self) -> Option<Sphere<R>> {
        self.inner.bounds()
    }
    fn value(&self, x: &[R::Vec3], f: &mut [R]) {
        add(&self.value, x.len());
        self.inner.value(x, f);
    }
    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]) {
        add(&self.gradient, x.len());
        self.inner.value_gradient(x, f, gradient);
    }
    fn hessian_vector(
        &self,
        x: &[R::Vec3],
        p: &[R::Vec3],
        gradient: &mut [R::Vec3],
        product: &mut [R::Vec3],
    ) {
        add(&self.hessian_vector, x.len());
        self.inner.hessian_vector(x, p, gradient, product);
    }
    fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]) {
        add(&self.parameter, x.len());
        self.inner.parameter_vjp(x, alpha, c, adjoint);
    }
    fn parameter_jvp(&self, x: &[R::Vec3], tangent: &[R], f: &mut [R], gradient: &mut [R::Vec3]) {
        add(&self.parameter, x.len());
        self.inner.parameter_jvp(x, tangent, f, gradient);
    }
}

macro_rules! forward {
    ($ty:ty) => {
        impl<R: Real, F: Field<R> + ?Sized> Field<R> for $ty {
            fn parameter_count(&self) -> usize {
                (**self).parameter_count()
            }
            fn bounds(&self) -> Option<Sphere<R>> {
                (**self).bounds()
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

forward!(&F);
forward!(Box<F>);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Shape;
    use glam::DVec3;

    #[test]
    fn counts_points_by_kind() {
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
