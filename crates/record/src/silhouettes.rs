//! Points of silhouettes.

use field::{Real, Vector3};

use crate::adjoints::{Adjoints, PointAdjoint};

/// A point of a silhouette.
#[derive(Clone, Copy, Debug)]
pub struct SilhouettePoint<R: Real> {
    /// The pixel, by its number in the batch.
    pub pixel: u32,
    /// The point, in world units.
    pub x: R::Vec3,
    /// −∂(pixel value)/∂f at the point: the increase of the pixel's value as f falls, linear RGB
    /// per world unit.
    pub rgb: R::Vec3,
}

/// The silhouette points of a batch of pixels.
#[derive(Clone, Debug)]
pub struct Silhouettes<R: Real> {
    /// The points.
    pub points: Vec<SilhouettePoint<R>>,
}

impl<R: Real> Default for Silhouettes<R> {
    fn default() -> Self {
        Silhouettes { points: Vec::new() }
    }
}

impl<R: Real> Silhouettes<R> {
    /// Adds a point x at which −∂(value of `pixel`)/∂f is `rgb`.
    pub fn push(&mut self, pixel: u32, x: R::Vec3, rgb: R::Vec3) {
        self.points.push(SilhouettePoint { pixel, x, rgb });
    }

    /// VJP of θ ↦ the silhouette terms of the pixel values.
    pub(crate) fn vjp(&self, delta: &[R::Vec3], out: &mut Adjoints<R>) {
        for SilhouettePoint { pixel, x, rgb } in self.points.iter().copied() {
            let alpha = -delta[pixel as usize].dot(rgb);
            out.push(PointAdjoint { pixel, x, alpha, c: R::Vec3::zero() });
        }
    }
}
