//! Fields that are not finite.

/// A NaN or an infinity met along a ray, with where it was met.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "the field is not finite along the ray of camera {camera} through film position {u}, from {eye} towards {direction}"
)]
pub struct InvalidField {
    /// The index of the camera.
    pub camera: usize,
    /// The film position, in pixels.
    pub u: glam::DVec2,
    /// Where the ray starts, in world units.
    pub eye: glam::DVec3,
    /// The ray's unit direction.
    pub direction: glam::DVec3,
}
