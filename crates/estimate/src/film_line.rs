//! Lines of the film, and the silhouettes that they cross.

use field::Real;
use glam::DVec2;
use render::Sample;

/// A line across a pixel along a film axis: s in [0, 1] runs from one border to the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FilmLine {
    /// The pixel, by its number in the batch.
    pub(crate) pixel: u32,
    pub(crate) camera: usize,
    /// The film axis that s runs along.
    pub(crate) axis: usize,
    pub(crate) start: DVec2,
    /// The weight of the line in the mean over the lines along its axis.
    pub(crate) share: f64,
}

impl FilmLine {
    /// The film sample at s.
    pub(crate) fn at(&self, s: f64) -> Sample {
        let mut u = self.start;
        u[self.axis] += s;
        Sample { camera: self.camera, u }
    }
}

/// A visible silhouette that a line crosses.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Crossing<R: Real> {
    /// The line, by its number.
    pub(crate) line: usize,
    pub(crate) s: f64,
    /// Whether the solid is left as s grows.
    pub(crate) leaves: bool,
    /// The points on both sides of the minimum of f along the ray.
    pub(crate) points: [R::Vec3; 2],
    /// Their weights, which sum to 1.
    pub(crate) weights: [R; 2],
    /// ∇_u m of m = min_t f, per pixel.
    pub(crate) film_gradient: [R; 2],
    /// The radiance inside less the radiance outside.
    pub(crate) contrast: R::Vec3,
}

/// How well the position of a crossing is known, in pixels: 1e-4, or 1e-3 in single precision. An
/// error of this size changes no image visibly.
pub(crate) fn tolerance<R: Real>() -> f64 {
    (R::epsilon().to_double() * 1e4).max(1e-4)
}
