//! The shader trait.

use std::ops::Range;

use crate::dual::Scalar;
use crate::partial_sum::PartialSum;
use crate::real::Real;
use crate::surface::{SurfaceAdjoint, SurfaceBatch};

/// A precision of scenes: `f32` or `f64`.
pub trait Precision: Real + Scalar<Real = Self> {}
impl<R: Real + Scalar<Real = R>> Precision for R {}

/// The radiance at surface points, over batches.
///
/// It is a function of the point x (world units), the unit normal n and the unit view direction d
/// (from the camera to the point), and has parameters of its own.
/// Radiance and its adjoints are linear RGB.
pub trait Shader<R: Real>: Send + Sync {
    /// The number of parameters.
    fn parameter_count(&self) -> usize;

    /// Whether the radiance is the same at every point and in every direction, for all values of
    /// the parameters. Estimators then skip its derivatives by x, n and d.
    fn is_uniform(&self) -> bool {
        false
    }

    /// Whether the radiance can jump on the surface at the edges of shadows.
    fn has_shadow_edges(&self) -> bool {
        false
    }

    /// Computes the radiance of every point. `rgb` has one element per point.
    fn radiance(&self, points: &SurfaceBatch<'_, R>, rgb: &mut [R::Vec3]);

    /// VJP of (x, n, d; parameters) ↦ radiance.
    ///
    /// `adjoint` has one element per point. The adjoints of x, n and d overwrite `bars`, that of
    /// the parameters is added to `parameters`.
    fn vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        adjoint: &[R::Vec3],
        bars: &mut SurfaceAdjoint<R>,
        parameters: &mut [R],
    );

    /// The parameters of which each value depends on few, for example features on a grid. By
    /// default none.
    fn table(&self) -> Range<usize> {
        0..0
    }

    /// As [`vjp`](Shader::vjp), for a part of a batch. A shader with a [`table`](Shader::table)
    /// keeps the adjoints of its parameters as additions.
    fn add_vjp(
        &self,
        points: &SurfaceBatch<'_, R>,
        adjoint: &[R::Vec3],
        bars: &mut SurfaceAdjoint<R>,
        sum: &mut PartialSum<R>,
    ) {
        debug_assert!(sum.place().is_empty(), "a table without additions");
        self.vjp(points, adjoint, bars, &mut sum.others);
    }
}
