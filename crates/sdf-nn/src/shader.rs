//! The radiance head's passes as methods, and the head as a shader.

use std::ops::Range;

use field::{PartialSum, Shader, SurfaceAdjoint, SurfaceBatch, TableSum};

use crate::head::{Radiance, RadianceHead, Vjp};
use crate::passes::{AnyPass, PassKind, Passes};

impl<R: Passes> RadianceHead<R> {
    /// Writes the radiance, in linear RGB, from every point of a batch towards the camera.
    pub fn radiance(&self, points: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]) {
        R::run(AnyPass(PassKind::Radiance(Radiance { head: self, points: *points, rgb })));
    }

    /// VJP of (x, n, d; θ) ↦ RGB to all of its inputs.
    ///
    /// `rgb_adjoint` has one element for each point. The adjoints of x, n and d replace the
    /// contents of `surface_adjoint`; that of θ is added to `parameter_adjoint`.
    ///
    /// # Panics
    /// If `parameter_adjoint` does not have the length of θ, or if `surface_adjoint` is shorter
    /// than the batch.
    pub fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        rgb_adjoint: &[R::Vec3],
        surface_adjoint: &mut SurfaceAdjoint<R>,
        parameter_adjoint: &mut [R],
    ) {
        assert_eq!(parameter_adjoint.len(), self.parameter_count(), "number of parameter adjoints");
        let (weights, tables) = parameter_adjoint.split_at_mut(self.mlp.parameters.len());
        let (points, tables) = (*points, TableSum::Vector(tables));
        let pass = Vjp { head: self, points, rgb_adjoint, surface_adjoint, weights, tables };
        R::run(AnyPass(PassKind::RadianceVjp(pass)));
    }

    /// The place of the features of details among the parameters.
    pub fn table(&self) -> Range<usize> {
        self.mlp.parameters.len()..self.parameter_count()
    }

    /// As [`vjp`](Self::vjp), for a part of a batch: the adjoints of the features of details are
    /// additions.
    ///
    /// # Panics
    /// If the table of `sum` has another place, or if `surface_adjoint` is shorter than the batch.
    pub fn add_vjp(
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

impl<R: Passes> Shader<R> for RadianceHead<R> {
    fn parameter_count(&self) -> usize {
        RadianceHead::parameter_count(self)
    }
    fn radiance(&self, points: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]) {
        RadianceHead::radiance(self, points, rgb);
    }
    fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        adjoint: &[R::Vec3],
        bars: &mut SurfaceAdjoint<R>,
        parameters: &mut [R],
    ) {
        RadianceHead::vjp(self, points, adjoint, bars, parameters);
    }
    fn table(&self) -> Range<usize> {
        RadianceHead::table(self)
    }
    fn add_vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        adjoint: &[R::Vec3],
        bars: &mut SurfaceAdjoint<R>,
        sum: &mut PartialSum<R>,
    ) {
        RadianceHead::add_vjp(self, points, adjoint, bars, sum);
    }
}
