//! The network as a field.

use std::ops::Range;

use field::{Field, PartialSum, Sphere, Vector3};

use crate::network::Network;
use crate::passes::Passes;

impl<R: Passes> Field<R> for Network<R> {
    fn parameter_count(&self) -> usize {
        self.parameters().len()
    }

    fn bounds(&self) -> Option<Sphere<R>> {
        let center = <R::Vec3 as Vector3<R>>::of(self.transform.center);
        Some(Sphere { center, radius: R::of(self.transform.radius) })
    }

    fn value(&self, x: &[R::Vec3], f: &mut [R]) {
        R::value(self, x, f);
    }

    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]) {
        R::value_gradient(self, x, f, gradient);
    }

    fn hessian_vector(
        &self,
        x: &[R::Vec3],
        p: &[R::Vec3],
        gradient: &mut [R::Vec3],
        product: &mut [R::Vec3],
    ) {
        R::hessian_vector(self, x, p, gradient, product);
    }

    fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]) {
        assert_eq!(adjoint.len(), self.parameter_count(), "number of parameter adjoints");
        R::parameter_vjp(self, x, (alpha, c), adjoint);
    }

    fn table(&self) -> Range<usize> {
        self.weight_count()..self.parameter_count()
    }

    fn add_parameter_vjp(
        &self,
        x: &[R::Vec3],
        alpha: &[R],
        c: &[R::Vec3],
        sum: &mut PartialSum<R>,
    ) {
        assert_eq!(sum.place(), self.table(), "place of the grid's coefficients");
        if !x.is_empty() {
            R::add_parameter_vjp(self, x, (alpha, c), sum);
        }
    }
}
