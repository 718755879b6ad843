//! A data set in memory: views, bounding sphere and surface points.

use std::path::PathBuf;

use field::Sphere;
use glam::DVec3;

use crate::{MaskKind, View};

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
    /// Points on the scene's surfaces, if the data set has any (COLMAP, or the point cloud of a
    /// `transforms.json`); else empty.
    pub points: Vec<DVec3>,
    /// For each of them, whether the data set vouches for it: at least 4 views see it, on average
    /// within 0.7 pixels of its place. Empty if the data set does not say this.
    pub is_sure: Vec<bool>,
    /// One sentence for each thing that a user should know about the reading: missing images,
    /// models that are not read, photographs that are cut.
    pub notes: Vec<String>,
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

    /// The points that the data set vouches for; all of them if it does not say.
    pub fn sure_points(&self) -> impl Iterator<Item = DVec3> {
        let is_sure = |i: usize| self.is_sure.get(i).is_none_or(|is_sure| *is_sure);
        let points = self.points.iter().enumerate();
        points.filter(move |(i, _)| is_sure(*i)).map(|(_, point)| *point)
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
