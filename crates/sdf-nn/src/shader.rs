//! The radiance head as a shader.

use std::ops::Range;

use field::{PartialSum, Shader, SurfaceAdjoint, SurfaceBatch};

use crate::head::RadianceHead;
use crate::passes::Passes;

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
