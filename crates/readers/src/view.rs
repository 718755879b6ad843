//! One posed photograph.

use std::path::PathBuf;

use film::Film;
use render::Camera;

use crate::Mask;

/// One posed photograph, without lens distortion.
#[derive(Clone, Debug)]
pub struct View {
    /// The image's name in the data set, for messages and pictures.
    pub name: String,
    /// The image's file.
    pub path: PathBuf,
    /// The pinhole camera of the image.
    pub camera: Camera,
    /// The photograph, linear RGB; composited over black if the file has an alpha channel.
    pub image: Film,
    /// The mask: the alpha channel, or else a mask image. `None` if the data set has neither for
    /// this view.
    pub mask: Option<Mask>,
}

impl View {
    /// The coverage of each pixel by the object, in [0, 1], if the mask tells it.
    pub fn coverage(&self) -> Option<&[f32]> {
        self.mask.as_ref().and_then(Mask::coverage)
    }

    /// Whether pixel `i`, row-major, is used: no mask leaves it out.
    pub fn is_used(&self, i: usize) -> bool {
        self.mask.as_ref().is_none_or(|mask| mask.is_used(i))
    }

    /// [`is_used`](Self::is_used) of each pixel, row-major.
    pub fn used(&self) -> impl Iterator<Item = bool> {
        (0..self.image.pixels.len()).map(|i| self.is_used(i))
    }
}
