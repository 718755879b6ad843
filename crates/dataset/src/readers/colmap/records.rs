//! The records of a sparse model, as both forms of its files have them.

use glam::DVec3;

/// A record of `cameras`: the camera model gives the parameters their meaning.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct CameraRecord {
    pub(super) id: u32,
    pub(super) model: String,
    /// Width and height in pixels.
    pub(super) size: [u64; 2],
    pub(super) parameters: Vec<f64>,
}

/// A record of `images`: an image and its world-to-camera pose.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ImageRecord {
    /// (w, x, y, z).
    pub(super) quaternion: [f64; 4],
    pub(super) translation: DVec3,
    /// The id of its [`CameraRecord`].
    pub(super) camera: u32,
    pub(super) name: String,
}

/// A record of `points3D`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PointRecord {
    pub(super) position: DVec3,
    /// Its mean distance in the images from the places where it was found, in pixels.
    pub(super) error: Option<f64>,
    /// The number of images in which it was found.
    pub(super) views: usize,
}

/// The least number of images of a sure point: COLMAP makes points of two and three images also
/// from wrong matches.
const SURE_VIEWS: usize = 4;

/// The largest error of a sure point, in pixels.
const SURE_ERROR: f64 = 0.7;

impl PointRecord {
    /// Whether enough images agree about the point.
    pub(super) fn is_sure(&self) -> bool {
        self.views >= SURE_VIEWS && self.error.is_some_and(|error| error < SURE_ERROR)
    }
}
