//! The units of parameters: a change by one unit moves the image by about one pixel.

use field::Sphere;
use glam::DVec2;
use render::Camera;

use crate::calibrate::freedom::{OF_LENS, OF_POSE};

/// The least distance of an eye from the centre of the bounding sphere that counts, in radii.
const MIN_EYE_DISTANCE: f64 = 0.1;

/// Half of the frame's longer side, in pixels.
pub(crate) fn half_frame(camera: &Camera) -> f64 {
    0.5 * f64::from(camera.width.max(camera.height))
}

/// The mean focal length, in pixels.
fn focal(camera: &Camera) -> f64 {
    let DVec2 { x, y } = camera.focal;
    0.5 * (x + y)
}

/// Radians of each rotation, and world units of each shift, per pixel at the sphere's centre.
pub(crate) fn of_pose(camera: &Camera, sphere: &Sphere<f64>) -> [f64; OF_POSE] {
    let distance = (camera.eye - sphere.center).length().max(MIN_EYE_DISTANCE * sphere.radius);
    let (turn, shift) = (1.0 / focal(camera), distance / focal(camera));
    [turn, turn, turn, shift, shift, shift]
}

/// The units of the focal length's logarithm, the principal point (pixels) and k₁, k₂: per pixel at
/// the border of the frame.
pub(crate) fn of_lens(camera: &Camera) -> [f64; OF_LENS] {
    let half = half_frame(camera);
    let p = half / focal(camera);
    [1.0 / half, 1.0, 1.0, 1.0 / (half * p * p), 1.0 / (half * p.powi(4))]
}
