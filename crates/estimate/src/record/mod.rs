//! The record that an estimator makes of a batch of pixels, and its reverse mode.

mod adjoints;
mod area;
mod border;
mod film_warp;
mod silhouettes;
mod surface;

use field::Real;
use render::Scene;

pub use adjoints::{Adjoints, PointAdjoint};
pub use area::{Area, AreaWarp, Share};
pub use border::{Border, BorderSample};
pub(crate) use film_warp::chart;
pub use film_warp::{FilmWarp, FilmWarpWithDivergence, warp_samples, warp_samples_with_divergence};
pub use silhouettes::{SilhouettePoint, Silhouettes};
pub use surface::{SurfaceCoefficients, surface_vjp};

/// All that is linear in the adjoints of a batch of pixels.
#[derive(Default)]
pub struct Record<R: Real> {
    /// The radiance of every pixel, from the estimator's own samples.
    pub radiance: Vec<R::Vec3>,
    /// The number of rays traced.
    pub rays: u64,
    /// Samples of the areas of pixels.
    pub area: Vec<Area<R>>,
    /// Samples of the borders of pixels.
    pub border: Option<Border<R>>,
    /// Points of silhouettes.
    pub silhouettes: Silhouettes<R>,
}

/// How reverse mode adds up its coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pass<R> {
    /// Each pixel's coefficients apart, as derivative images need them.
    PerPixel,
    /// The coefficients of all pixels together.
    Sum,
    /// As `Sum`, with a limit on the coefficient of f of one sample: this many times the
    /// coefficient of a silhouette that crosses the sample's whole pixel.
    Limited(R),
}

impl<R: Real> Record<R> {
    /// A record of `pixels` pixels without radiance and samples.
    pub fn black(pixels: usize) -> Self {
        Record { radiance: vec![field::Vector3::zero(); pixels], ..Record::default() }
    }

    /// VJP of parameters ↦ pixel values.
    ///
    /// `delta` has one adjoint a pixel. Coefficients at points are added to `out`, the adjoint of
    /// the shader's parameters to `shader`. The points do not depend on `delta`.
    pub fn vjp(
        &self,
        scene: &Scene<'_, R>,
        delta: &[R::Vec3],
        pass: Pass<R>,
        shader: &mut [R],
        out: &mut Adjoints<R>,
    ) {
        for area in &self.area {
            area.vjp(scene, delta, pass, shader, out);
        }
        if let Some(border) = &self.border {
            border.vjp(delta, pass, out);
        }
        self.silhouettes.vjp(delta, out);
    }
}
