//! Points of silhouettes.

use field::{Real, Vector3};
use render::Scene;

use crate::record::adjoints::{Adjoints, PointAdjoint};

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
    /// −∂(coverage of the pixel)/∂f at the point, per world unit; zero where the object is on both
    /// sides, and for estimators that do not tell.
    pub coverage: R,
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
    /// Adds a point x at which −∂(value of `pixel`)/∂f is `rgb`, without the coverage.
    pub fn push(&mut self, pixel: u32, x: R::Vec3, rgb: R::Vec3) {
        self.points.push(SilhouettePoint { pixel, x, rgb, coverage: R::zero() });
    }

    /// VJP of (θ; cameras) ↦ the silhouette terms of the pixel values.
    ///
    /// ∇f is evaluated at every point if the adjoints of the cameras are wanted.
    pub(crate) fn vjp(&self, scene: &Scene<'_, R>, delta: &[R::Vec3], out: &mut Adjoints<R>) {
        let alpha = |point: &SilhouettePoint<R>| -delta[point.pixel as usize].dot(point.rgb);
        if let Some(cameras) = &mut out.cameras {
            let x: Vec<R::Vec3> = self.points.iter().map(|point| point.x).collect();
            let (mut f, mut g) = (vec![R::zero(); x.len()], vec![R::Vec3::zero(); x.len()]);
            scene.field.value_gradient(&x, &mut f, &mut g);
            for (point, g) in self.points.iter().zip(g) {
                cameras.add_silhouette(scene, point.pixel, point.x, g, alpha(point));
            }
        }
        self.add(alpha, out);
    }

    /// VJP of θ ↦ the coverage of the pixels.
    pub(crate) fn coverage_vjp(&self, delta: &[R], out: &mut Adjoints<R>) {
        self.add(|point| -delta[point.pixel as usize] * point.coverage, out);
    }

    /// Adds the points with these coefficients of f.
    fn add(&self, alpha: impl Fn(&SilhouettePoint<R>) -> R, out: &mut Adjoints<R>) {
        for point in &self.points {
            let SilhouettePoint { pixel, x, .. } = *point;
            out.push(pixel, PointAdjoint { x, alpha: alpha(point), c: R::Vec3::zero() });
        }
    }
}
