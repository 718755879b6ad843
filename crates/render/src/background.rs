//! The radiance along rays that hit nothing.

use field::{Real, Vector3};

/// A ray that hits nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BackgroundRay<R: Real> {
    /// The index of its camera in the scene.
    pub camera: usize,
    /// The eye, in world units.
    pub origin: R::Vec3,
    /// The unit direction.
    pub direction: R::Vec3,
}

/// The radiance B(o, d; φ) along rays that hit nothing, over batches.
///
/// It is a function of the ray, of the number of its camera and of parameters φ of its own. It does
/// not depend on the field: a change of the field only changes the rays that read it. Radiance and
/// its adjoints are linear RGB.
pub trait Background<R: Real>: Send + Sync {
    /// The number of parameters.
    fn parameter_count(&self) -> usize;

    /// The radiance, if it is the same along all rays. Estimators then skip its derivatives by d.
    fn uniform(&self) -> Option<R::Vec3> {
        None
    }

    /// Computes the radiance of every ray. `rgb` has one element per ray.
    fn radiance(&self, rays: &[BackgroundRay<R>], rgb: &mut [R::Vec3]);

    /// VJP of d ↦ radiance.
    ///
    /// `adjoint` has one element per ray. The adjoints of the directions overwrite `direction`.
    fn direction_vjp(
        &self,
        rays: &[BackgroundRay<R>],
        adjoint: &[R::Vec3],
        direction: &mut [R::Vec3],
    );

    /// VJP of φ ↦ radiance.
    ///
    /// `adjoint` has one element per ray. The adjoint of the parameters is added to `parameters`.
    fn parameter_vjp(&self, rays: &[BackgroundRay<R>], adjoint: &[R::Vec3], parameters: &mut [R]);
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

    fn direction_vjp(&self, _: &[BackgroundRay<R>], _: &[R::Vec3], direction: &mut [R::Vec3]) {
        direction.fill(R::Vec3::zero());
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

    fn direction_vjp(&self, _: &[BackgroundRay<R>], _: &[R::Vec3], direction: &mut [R::Vec3]) {
        direction.fill(R::Vec3::zero());
    }

    fn parameter_vjp(&self, rays: &[BackgroundRay<R>], adjoint: &[R::Vec3], parameters: &mut [R]) {
        for (ray, adjoint) in rays.iter().zip(adjoint) {
            let own = &mut parameters[3 * ray.camera..][..3];
            own.iter_mut().zip(adjoint.to_array()).for_each(|(sum, adjoint)| *sum += adjoint);
        }
    }
}
