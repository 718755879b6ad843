//! The readers: one file a format.
//!
//! A reader parses cameras and finds image files. It does not read pixels: that is the work of
//! `UnreadView`.

mod colmap;
mod middlebury;
mod nerf;
mod neus;

use std::path::Path;

use field::Sphere;
use glam::DVec3;
use io::InputError;

use crate::unread::UnreadView;

type Result<T> = std::result::Result<T, InputError>;

/// The content of a data set before its images are read.
pub(crate) struct Recognised {
    /// The format and camera convention, as text.
    pub(crate) format: String,
    /// Views to fit.
    pub(crate) train: Vec<UnreadView>,
    /// Held-out views; `None` if the format has no split of its own.
    pub(crate) test: Option<Vec<UnreadView>>,
    /// The bounding sphere, if the format has one.
    pub(crate) bounds: Option<Sphere<f64>>,
    /// Points on the scene's surfaces, if the format has any.
    pub(crate) points: Vec<DVec3>,
}

const EXPECTED: &str = "transforms_train.json, transforms.json, cameras_sphere.npz, *_par.txt \
     or a COLMAP model (cameras.bin or .txt)";

/// Recognises the format by the files in `folder` and runs its reader.
///
/// If `path` itself is a `.json` file, it is the camera file. If `folder` has files of several
/// formats, the first in the order of this function is taken.
///
/// # Errors
/// If the folder cannot be listed, no format matches, or the reader fails.
pub(crate) fn recognise(folder: &Path, path: &Path) -> Result<Recognised> {
    let entries = std::fs::read_dir(folder)
        .map_err(|e| InputError::new(folder, "data set", e, "a readable folder"))?;
    let names: Vec<String> =
        entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    let has = |name: &str| names.iter().any(|n| n == name);
    if path.is_file() && path.extension().is_some_and(|e| e == "json") {
        nerf::read(folder, path)
    } else if has("transforms_train.json") {
        nerf::read(folder, &folder.join("transforms_train.json"))
    } else if has("transforms.json") {
        nerf::read(folder, &folder.join("transforms.json"))
    } else if has("cameras_sphere.npz") {
        neus::read(folder)
    } else if let Some(name) = names.iter().filter(|n| n.ends_with("_par.txt")).min() {
        middlebury::read(folder, &folder.join(name))
    } else if let Some(model) = colmap::model_folder(folder) {
        colmap::read(&model)
    } else {
        Err(InputError::new(folder, "data set", "no camera file", EXPECTED))
    }
}
