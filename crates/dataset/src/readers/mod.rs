//! The camera files of other programs, one module a format, and lenses.

#![warn(clippy::cast_possible_truncation)]

mod blended_mvs;
mod colmap;
mod distortion;
mod images;
mod lens;
mod llff;
mod mask;
mod metashape;
mod middlebury;
mod nerf;
mod neus;
mod notes;
mod npy;
mod pixels;
mod ply;
mod projection;
mod recognised;
mod result;
mod unread;
mod unsupported;
mod view;

pub use colmap::{SparseCamera, SparseModel, sparse_model};
pub use distortion::Distortion;
pub use mask::{ALL_USED, Mask, MaskKind};
pub use recognised::Recognised;
pub use unread::UnreadView;
pub use view::View;

use std::path::Path;

use files::InputError;

use result::Result;

/// Recognises the format by the files in `folder` and runs its reader.
///
/// If `path` itself is a `.json` or `.xml` file, it is the camera file. If `folder` has files of
/// several formats, the first in the order of the README's table is taken.
///
/// Views whose image is missing are left out, with a note.
///
/// # Errors
/// If the folder cannot be listed, no format matches, the reader fails, or more than half of the
/// images to fit are missing. A known format without a reader is named, with a way to convert it.
pub fn recognise(folder: &Path, path: &Path) -> Result<Recognised> {
    let mut recognised = read(folder, path)?;
    notes::add(&mut recognised, path)?;
    Ok(recognised)
}

fn read(folder: &Path, path: &Path) -> Result<Recognised> {
    let entries = std::fs::read_dir(folder)
        .map_err(|e| InputError::new(folder, "data set", e, "a readable folder"))?;
    let mut names: Vec<String> =
        entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    let has = |name: &str| names.iter().any(|n| n == name);
    let ends = |end: &str| names.iter().find(|n| n.ends_with(end));
    let named =
        |extension: &str| path.is_file() && path.extension().is_some_and(|e| e == extension);
    if named("json") {
        nerf::read(folder, path)
    } else if named("xml") {
        metashape::read(folder, path)
    } else if has("transforms_train.json") {
        nerf::read(folder, &folder.join("transforms_train.json"))
    } else if has("transforms.json") {
        nerf::read(folder, &folder.join("transforms.json"))
    } else if has("cameras_sphere.npz") {
        neus::read(folder, "cameras_sphere.npz")
    } else if has("cameras.npz") {
        neus::read(folder, "cameras.npz")
    } else if let Some(name) = ends("_par.txt") {
        middlebury::read(folder, &folder.join(name))
    } else if let Some(models) = colmap::models(folder) {
        colmap::read(folder, &models)
    } else if has("poses_bounds.npy") {
        llff::read(folder)
    } else if let Some(cameras) = blended_mvs::cameras(folder) {
        blended_mvs::read(folder, &cameras)
    } else if let Some(name) = names.iter().find(|n| metashape::is_camera_file(&folder.join(n))) {
        metashape::read(folder, &folder.join(name))
    } else {
        Err(unsupported::error(folder, &names))
    }
}
