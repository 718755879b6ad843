//! Shaders: the radiance that leaves surface points, and its derivatives.

mod analytic;
mod shadowed;

use field::{Real, Scalar, SurfaceAdjoint, SurfaceBatch};
use sdf_nn::RadianceHead;

pub use analytic::{Analytic, Formula, Light, MAX_LIGHTS};
pub use shadowed::Shadowed;

/// The precisions that scenes and networks are evaluated in.
pub trait Precision: Real + Scalar<Real = Self> + sdf_nn::Lane {}
impl<R: Real + Scalar<Real = R> + sdf_nn::Lane> Precision for R {}

/// Radiance at surface points, over batches: a function of the point x, the unit normal n and the
/// unit view direction d (from the camera to the point), with parameters of its own. Vectors of
/// colour are linear RGB.
pub trait Shader<R: Real>: Send + Sync {
    /// The number of parameters.
    fn parameter_count(&self) -> usize;

    /// Whether radiance is the same at every point in every direction, whatever the parameters.
    fn is_uniform(&self) -> bool {
        false
    }

    /// The radiance of every point.
    fn radiance(&self, points: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]);

    /// VJP of (x, n, d; parameters) ↦ radiance: overwrites `bars`, adds to `parameters`.
    fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        adjoint: &[R::Vec3],
        bars: &mut SurfaceAdjoint<R>,
        parameters: &mut [R],
    );
}

impl<R: Precision> Shader<R> for RadianceHead<R> {
    fn parameter_count(&self) -> usize {
        self.parameters().len()
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
}
