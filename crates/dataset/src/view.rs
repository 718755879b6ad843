//! A data set in memory: views, bounding sphere and surface points.

use std::path::PathBuf;

use field::Sphere;
use film::Film;
use glam::DVec3;
use render::Camera;

use crate::{Mask, MaskKind};

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

/// A data set. Lengths are in its own units. Positions are relative to the origin of these units,
/// or to a point given to [`Dataset::about`].
#[derive(Clone, Debug)]
pub struct Dataset {
    /// The folder or camera file that was loaded.
    pub path: PathBuf,
    /// The recognised format and camera convention, as text.
    pub format: String,
    /// Views to fit.
    pub train: Vec<View>,
    /// Held-out views, for evaluation only.
    pub test: Vec<View>,
    /// The bounding sphere, if the data set has one (NeuS/IDR `scale_mat`).
    pub bounds: Option<Sphere<f64>>,
    /// Points on the scene's surfaces, if the data set has any (COLMAP); else empty.
    pub points: Vec<DVec3>,
}

impl Dataset {
    /// The same data set without masks that leave pixels out: all pixels are used.
    #[must_use]
    pub fn with_all_pixels(mut self) -> Self {
        for view in self.train.iter_mut().chain(&mut self.test) {
            view.mask.take_if(|mask| mask.kind == MaskKind::Used);
        }
        self
    }

    /// The same data set with positions relative to `origin`, a point in its own units.
    #[must_use]
    pub fn about(mut self, origin: DVec3) -> Self {
        for view in self.train.iter_mut().chain(&mut self.test) {
            view.camera = view.camera.about(origin);
        }
        if let Some(bounds) = &mut self.bounds {
            bounds.center -= origin;
        }
        self.points.iter_mut().for_each(|point| *point -= origin);
        self
    }
}
