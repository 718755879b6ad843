//! The units of the parameters of a lens: a change by one unit moves the image by about one pixel.

use glam::DVec2;
use render::Camera;

use crate::freedom::OF_LENS;

/// Half of the frame's longer side, in pixels.
fn half_frame(camera: &Camera) -> f64 {
    0.5 * f64::from(camera.width.max(camera.height))
}

/// The mean focal length, in pixels.
pub(crate) fn focal(camera: &Camera) -> f64 {
    let DVec2 { x, y } = camera.focal;
    0.5 * (x + y)
}

/// The units of the focal length's logarithm, the principal point (pixels) and k₁, k₂: per pixel at
/// the border of the frame.
pub(crate) fn of_lens(camera: &Camera) -> [f64; OF_LENS] {
    let half = half_frame(camera);
    let p = half / focal(camera);
    [1.0 / half, 1.0, 1.0, 1.0 / (half * p * p), 1.0 / (half * p.powi(4))]
}
