//! The files of one sparse model.

use std::path::{Path, PathBuf};

use super::records::{CameraRecord, ImageRecord, PointRecord};
use super::{binary, text};
use crate::readers::ply;
use crate::readers::result::Result;

/// The three files of a model, all text or all binary.
pub(super) struct Model {
    pub(super) binary: bool,
    pub(super) cameras: PathBuf,
    pub(super) images: PathBuf,
    pub(super) points: PathBuf,
}

impl Model {
    /// If a folder has both forms, the binary one is read, as COLMAP does.
    pub(super) fn in_folder(folder: &Path) -> Self {
        let binary = folder.join("cameras.bin").is_file();
        let extension = if binary { "bin" } else { "txt" };
        let [cameras, images, points] = ["cameras", "images", "points3D"]
            .map(|name| folder.join(format!("{name}.{extension}")));
        Model { binary, cameras, images, points }
    }

    pub(super) fn cameras(&self) -> Result<Vec<CameraRecord>> {
        if self.binary { binary::cameras(&self.cameras) } else { text::cameras(&self.cameras) }
    }

    pub(super) fn images(&self) -> Result<Vec<ImageRecord>> {
        if self.binary { binary::images(&self.images) } else { text::images(&self.images) }
    }

    /// The finite points; none if the file is missing.
    pub(super) fn points(&self) -> Result<Vec<PointRecord>> {
        let mut points = match self.points.is_file() {
            true if self.binary => binary::points(&self.points)?,
            true => text::points(&self.points)?,
            // Copies of a model for Gaussian splatting may have the points in this form alone.
            false if self.points.with_extension("ply").is_file() => {
                let points = ply::points(&self.points.with_extension("ply"))?;
                let record = |position| PointRecord { position, error: None, views: 0 };
                points.into_iter().map(record).collect()
            }
            false => Vec::new(),
        };
        points.retain(|p| p.position.is_finite());
        Ok(points)
    }
}
