//! The radiance along rays that hit nothing.

use std::ops::Range;

use glam::DVec2;

use crate::partial_sum::PartialSum;
use crate::real::{Real, Vector3};

/// A place on the film of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmPlace {
    /// The position from the upper left corner, in pixels.
    pub u: DVec2,
    /// The width and the height of the film, in pixels.
    pub size: [u32; 2],
}

/// A ray that hits nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BackgroundRay<R: Real> {
    /// The index of its camera in the scene.
    pub camera: usize,
    /// The place on the film that the ray belongs to.
    pub film: FilmPlace,
    /// The eye, in world units.
    pub origin: R::Vec3,
    /// The unit direction.
    pub direction: R::Vec3,
}

/// The adjoint of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayAdjoint<R: Real> {
    /// That of the origin, per world unit.
    pub origin: R::Vec3,
    /// That of the unit direction. Its part along the direction has no meaning.
    pub direction: R::Vec3,
}

impl<R: Real> RayAdjoint<R> {
    /// The adjoint of a ray without influence.
    pub fn zero() -> Self {
        RayAdjoint { origin: R::Vec3::zero(), direction: R::Vec3::zero() }
    }
}

/// The radiance B(o, d; φ) along rays that hit nothing, over batches.
///
/// It is a function of the ray, of the number of its camera and of parameters φ of its own. It does
/// not depend on the field: a change of the field only changes the rays that read it. Radiance and
/// its adjoints are linear RGB.
pub trait Background<R: Real>: Send + Sync {
    /// The number of parameters.
    fn parameter_count(&self) -> usize;

    /// The radiance, if it is the same along all rays. Estimators then skip its derivatives by o
    /// and d.
    fn uniform(&self) -> Option<R::Vec3> {
        None
    }

    /// Computes the radiance of every ray. `rgb` has one element per ray.
    fn radiance(&self, rays: &[BackgroundRay<R>], rgb: &mut [R::Vec3]);

    /// VJP of (o, d) ↦ radiance.
    ///
    /// `adjoint` has one element per ray. The adjoints of the rays overwrite `bars`.
    fn ray_vjp(&self, rays: &[BackgroundRay<R>], adjoint: &[R::Vec3], bars: &mut [RayAdjoint<R>]);

    /// VJP of φ ↦ radiance.
    ///
    /// `adjoint` has one element per ray. The adjoint of the parameters is added to `parameters`.
    fn parameter_vjp(&self, rays: &[BackgroundRay<R>], adjoint: &[R::Vec3], parameters: &mut [R]);

    /// The parameters of which each ray depends on few, for example features on a grid. By default
    /// none.
    fn table(&self) -> Range<usize> {
        0..0
    }

    /// As [`parameter_vjp`](Background::parameter_vjp), for a part of a batch. A background with a
    /// [`table`](Background::table) keeps the adjoints of its parameters as additions.
    fn add_parameter_vjp(
        &self,
        rays: &[BackgroundRay<R>],
        adjoint: &[R::Vec3],
        sum: &mut PartialSum<R>,
    ) {
        debug_assert!(sum.place().is_empty(), "a table without additions");
        self.parameter_vjp(rays, adjoint, &mut sum.others);
    }
}

/// The same radiance along all rays. Its parameters are red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UniformBackground<R: Real>(pub R::Vec3);

impl<R: Real> Background<R> for UniformBackground<R> {
    fn parameter_count(&self) -> usize {
        3
    }

    fn uniform(&self) -> Option<R::Vec3> {
        Some(self.0)
    }

    fn radiance(&self, _: &[BackgroundRay<R>], rgb: &mut [R::Vec3]) {
        rgb.fill(self.0);
    }

    fn ray_vjp(&self, _: &[BackgroundRay<R>], _: &[R::Vec3], bars: &mut [RayAdjoint<R>]) {
        bars.fill(RayAdjoint::zero());
    }

    fn parameter_vjp(&self, _: &[BackgroundRay<R>], adjoint: &[R::Vec3], parameters: &mut [R]) {
        for adjoint in adjoint {
            let rgb = adjoint.to_array();
            parameters.iter_mut().zip(rgb).for_each(|(sum, adjoint)| *sum += adjoint);
        }
    }
}

/// One radiance for each camera of the scene, by its number. The parameters are red, green and blue
/// of each camera.
#[derive(Clone, Debug, PartialEq)]
pub struct BackgroundPerCamera<R: Real>(pub Vec<R::Vec3>);

impl<R: Real> Background<R> for BackgroundPerCamera<R> {
    fn parameter_count(&self) -> usize {
        3 * self.0.len()
    }

    fn radiance(&self, rays: &[BackgroundRay<R>], rgb: &mut [R::Vec3]) {
        rays.iter().zip(rgb).for_each(|(ray, rgb)| *rgb = self.0[ray.camera]);
    }

    fn ray_vjp(&self, _: &[BackgroundRay<R>], _: &[R::Vec3], bars: &mut [RayAdjoint<R>]) {
        bars.fill(RayAdjoint::zero());
    }

    fn parameter_vjp(&self, rays: &[BackgroundRay<R>], adjoint: &[R::Vec3], parameters: &mut [R]) {
        for (ray, adjoint) in rays.iter().zip(adjoint) {
            let own = &mut parameters[3 * ray.camera..][..3];
            own.iter_mut().zip(adjoint.to_array()).for_each(|(sum, adjoint)| *sum += adjoint);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// Rays of three cameras, with an adjoint for each. No ray is of camera 1.
    fn rays() -> (Vec<BackgroundRay<f64>>, Vec<DVec3>) {
        let film = FilmPlace { u: DVec2::ZERO, size: [1, 1] };
        let ray = |camera| BackgroundRay { camera, film, origin: DVec3::ZERO, direction: DVec3::X };
        let adjoints = [[1.0, 2.0, 3.0], [-0.5, 0.25, 4.0], [0.5, 7.0, -1.0], [0.0, -3.0, 2.0]];
        ([2, 0, 2, 0].map(ray).to_vec(), adjoints.map(DVec3::from).to_vec())
    }

    /// Checks the VJPs of a background, which `of` makes from its parameters.
    fn check<B: Background<f64>>(start: &[f64], of: impl Fn(&[f64]) -> B) {
        let (rays, adjoint) = rays();
        let background = of(start);
        assert_eq!(background.parameter_count(), start.len());
        // Σ adjoint · radiance. It is linear in the parameters, so its difference is exact.
        let weighted = |parameters: &[f64]| -> f64 {
            let mut rgb = vec![DVec3::NAN; rays.len()];
            of(parameters).radiance(&rays, &mut rgb);
            rgb.iter().zip(&adjoint).map(|(rgb, adjoint)| rgb.dot(*adjoint)).sum()
        };
        // The adjoint is added to the content.
        let mut found = vec![10.0; start.len()];
        background.parameter_vjp(&rays, &adjoint, &mut found);
        for (i, found) in found.into_iter().enumerate() {
            let mut moved = start.to_vec();
            moved[i] += 1.0;
            let difference = weighted(&moved) - weighted(start);
            assert!((found - 10.0 - difference).abs() < 1e-12, "{i}: {found} {difference}");
        }
        let nan = RayAdjoint { origin: DVec3::NAN, direction: DVec3::NAN };
        let mut bars = vec![nan; rays.len()];
        background.ray_vjp(&rays, &adjoint, &mut bars);
        assert!(bars.iter().all(|bar| *bar == RayAdjoint::zero()), "{bars:?}");
    }

    #[test]
    fn the_adjoint_of_a_uniform_radiance_is_the_difference() {
        check(&[0.1, 0.2, 0.3], |rgb| UniformBackground(DVec3::from_slice(rgb)));
    }

    #[test]
    fn the_adjoint_of_a_radiance_per_camera_is_the_difference() {
        let start: Vec<f64> = (0..9).map(|i| 0.1 * f64::from(i)).collect();
        let of = |rgb: &[f64]| {
            BackgroundPerCamera::<f64>(rgb.chunks(3).map(DVec3::from_slice).collect())
        };
        check(&start, of);
        let (rays, adjoint) = rays();
        let mut parameters = [0.0; 9];
        of(&start).parameter_vjp(&rays, &adjoint, &mut parameters);
        // Of camera 0 the second and the last ray, of camera 1 none, of camera 2 the others.
        assert_eq!(parameters, [-0.5, -2.75, 6.0, 0.0, 0.0, 0.0, 1.5, 9.0, 2.0]);
    }
}
