//! Adjoints of cameras, from those of rays.
//!
//! A change of a camera moves the rays of its pixels, and not the solid. At a hit, the ray's
//! tangent plane gives the motion of the point; at a silhouette, ∇f·(∂o + t ∂d) is the change of f
//! at the point where the ray touches the solid.

use field::RayAdjoint;
use field::{Real, Vector3};
use glam::DVec3;
use render::{CameraAdjoint, Sample, Scene};

/// The sums of the adjoints of the cameras of a batch of pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraAdjoints {
    /// The camera of each pixel of the batch, by its number in the scene.
    of_pixel: Vec<usize>,
    /// One sum for each camera of the scene.
    pub sums: Vec<CameraAdjoint>,
}

impl CameraAdjoints {
    /// Sums of zero for `cameras` cameras. `of_pixel` has the number of the camera of each pixel.
    pub fn new(of_pixel: Vec<usize>, cameras: usize) -> Self {
        CameraAdjoints { of_pixel, sums: vec![CameraAdjoint::default(); cameras] }
    }

    /// Goes on with another batch of pixels of the same cameras, to the same sums.
    pub fn continue_with(&mut self, of_pixel: Vec<usize>) {
        self.of_pixel = of_pixel;
    }

    /// Adds the adjoint of the ray of a film sample.
    pub(crate) fn add_ray<R: Real>(
        &mut self,
        scene: &Scene<'_, R>,
        sample: &Sample,
        bar: RayAdjoint<R>,
    ) {
        let [eye, direction] = [bar.origin, bar.direction].map(|bar| double::<R>(bar));
        self.sums[sample.camera] += scene.cameras[sample.camera].ray_vjp(sample.u, eye, direction);
    }

    /// Adds a silhouette of `pixel` through the point `x` with ∇f = `gradient`; `alpha` is the
    /// coefficient of f there.
    pub(crate) fn add_silhouette<R: Real>(
        &mut self,
        scene: &Scene<'_, R>,
        pixel: u32,
        x: R::Vec3,
        gradient: R::Vec3,
        alpha: R,
    ) {
        let number = self.of_pixel[pixel as usize];
        let camera = &scene.cameras[number];
        let (x, bar) = (double::<R>(x), double::<R>(gradient) * alpha.to_double());
        if let Some(u) = camera.project(x) {
            self.sums[number] += camera.ray_vjp(u, bar, bar * (x - camera.eye).length());
        }
    }
}

fn double<R: Real>(v: R::Vec3) -> DVec3 {
    v.to_double()
}
