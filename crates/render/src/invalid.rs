//! The error of a field that is not finite.

use crate::camera::Camera;
use crate::sample::Sample;

/// The field gave a NaN or an infinity along this ray.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the field is not finite along the ray of camera {camera} through film position {u}, \
     from {eye} towards {direction}"
)]
pub struct InvalidField {
    /// The index of the camera in the scene.
    pub camera: usize,
    /// The film position, in pixels.
    pub u: glam::DVec2,
    /// The ray's origin, in world units.
    pub eye: glam::DVec3,
    /// The ray's unit direction.
    pub direction: glam::DVec3,
}

impl InvalidField {
    /// The error for the ray of a sample.
    pub fn at(cameras: &[Camera], Sample { camera, u }: Sample) -> Self {
        let (eye, direction) = (cameras[camera].eye, cameras[camera].direction(u));
        InvalidField { camera, u, eye, direction }
    }
}
