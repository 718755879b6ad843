//! The radiance head as a shader.

use std::ops::Range;

use field::{PartialSum, Shader, SurfaceAdjoint, SurfaceBatch, TableSum};

use crate::head::{Radiance, RadianceHead, Vjp};
use crate::passes::{AnyPass, PassKind, Passes};

impl<R: Passes> Shader<R> for RadianceHead<R> {
    fn parameter_count(&self) -> usize {
        RadianceHead::parameter_count(self)
    }

    fn radiance(&self, points: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]) {
        R::run(AnyPass(PassKind::Radiance(Radiance { head: self, points: *points, rgb })));
    }

    fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        rgb_adjoint: &[R::Vec3],
        surface_adjoint: &mut SurfaceAdjoint<R>,
        parameter_adjoint: &mut [R],
    ) {
        let count = RadianceHead::parameter_count(self);
        assert_eq!(parameter_adjoint.len(), count, "number of parameter adjoints");
        let (weights, tables) = parameter_adjoint.split_at_mut(self.mlp.parameters.len());
        let (points, tables) = (*points, TableSum::Vector(tables));
        let pass = Vjp { head: self, points, rgb_adjoint, surface_adjoint, weights, tables };
        R::run(AnyPass(PassKind::RadianceVjp(pass)));
    }

    /// The place of the features of details among the parameters.
    fn table(&self) -> Range<usize> {
        self.mlp.parameters.len()..RadianceHead::parameter_count(self)
    }

    fn add_vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        rgb_adjoint: &[R::Vec3],
        surface_adjoint: &mut SurfaceAdjoint<R>,
        sum: &mut PartialSum<R>,
    ) {
        assert_eq!(sum.place(), self.table(), "place of the features of details");
        if !points.is_empty() {
            let points = *points;
            let (weights, tables) = (&mut sum.others[..], TableSum::Additions(&mut sum.table));
            let pass = Vjp { head: self, points, rgb_adjoint, surface_adjoint, weights, tables };
            R::run(AnyPass(PassKind::RadianceVjp(pass)));
        }
    }
}
