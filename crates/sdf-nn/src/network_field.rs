//! The network as a field.

use std::ops::Range;

use field::{Field, PartialSum, Sphere, TableSum, Vector3};

use crate::network::Network;
use crate::network_passes::{HessianVector, ParameterVjp, Value, ValueGradient};
use crate::passes::{AnyPass, PassKind, Passes};

impl<R: Passes> Field<R> for Network<R> {
    fn parameter_count(&self) -> usize {
        self.parameters().len()
    }

    fn bounds(&self) -> Option<Sphere<R>> {
        let center = <R::Vec3 as Vector3<R>>::of(self.transform.center);
        Some(Sphere { center, radius: R::of(self.transform.radius) })
    }

    fn value(&self, x: &[R::Vec3], f: &mut [R]) {
        R::run(AnyPass(PassKind::Value(Value { network: self, x, f })));
    }

    fn value_gradient(&self, x: &[R::Vec3], f: &mut [R], gradient: &mut [R::Vec3]) {
        let pass = ValueGradient { network: self, x, f, gradient };
        R::run(AnyPass(PassKind::ValueGradient(pass)));
    }

    fn hessian_vector(
        &self,
        x: &[R::Vec3],
        p: &[R::Vec3],
        gradient: &mut [R::Vec3],
        product: &mut [R::Vec3],
    ) {
        let pass = HessianVector { network: self, x, p, gradient, product };
        R::run(AnyPass(PassKind::HessianVector(pass)));
    }

    fn parameter_vjp(&self, x: &[R::Vec3], alpha: &[R], c: &[R::Vec3], adjoint: &mut [R]) {
        assert_eq!(adjoint.len(), self.parameter_count(), "number of parameter adjoints");
        let (weights, table) = adjoint.split_at_mut(self.weight_count());
        let table = TableSum::Vector(table);
        let pass = ParameterVjp { network: self, x, alpha, c, weights, table };
        R::run(AnyPass(PassKind::ParameterVjp(pass)));
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
            let (weights, table) = (&mut sum.others[..], TableSum::Additions(&mut sum.table));
            let pass = ParameterVjp { network: self, x, alpha, c, weights, table };
            R::run(AnyPass(PassKind::ParameterVjp(pass)));
        }
    }
}
