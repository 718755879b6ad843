//! The camera files of other programs, one module a format, and lenses.

#![warn(clippy::cast_possible_truncation)]

mod blended_mvs;
mod colmap;
mod distortion;
mod images;
mod lens;
mod llff;
mod lookup;
mod mask;
mod mask_files;
mod metashape;
mod middlebury;
mod nerf;
mod neus;
mod notes;
mod pixels;
mod ply;
mod projection;
mod recognised;
mod result;
mod sdfstudio;
mod splats;
mod unread;
mod unsupported;
mod view;

pub use colmap::{SparseCamera, SparseModel, sparse_model};
pub use distortion::Distortion;
pub use mask::{ALL_USED, Mask, MaskKind};
pub(crate) use mask_files::dynamic;
pub use mask_files::is_mask_of;
pub use recognised::Recognised;
pub use unread::UnreadView;
pub use view::View;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

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
    drop_doubles(&mut recognised);
    let of_image = |views: Vec<UnreadView>| views.into_iter().map(UnreadView::of_resized_image);
    recognised.train = of_image(recognised.train).collect::<Result<_>>()?;
    recognised.test = recognised.test.map(|test| of_image(test).collect()).transpose()?;
    mask_files::find(&mut recognised, folder);
    notes::add(&mut recognised, path)?;
    Ok(recognised)
}

/// Takes views out that have the image of another view, since their own is missing: names are read
/// loosely, and `left/1.png` may have found the `1.png` of `right/1.png`.
fn drop_doubles(recognised: &mut Recognised) {
    let mut names: BTreeMap<PathBuf, BTreeSet<String>> = BTreeMap::new();
    let plain = |name: &str| lookup::folded(&Path::new(name).with_extension("").to_string_lossy());
    for view in recognised.views() {
        names.entry(view.path.clone()).or_default().insert(plain(&view.name));
    }
    let is_double = |view: &UnreadView| {
        let path = plain(&view.path.to_string_lossy());
        let name = plain(view.name.trim_start_matches("./"));
        names[&view.path].len() > 1 && !path.ends_with(&name)
    };
    let take = |views: &mut Vec<UnreadView>, missing: &mut Vec<PathBuf>| {
        missing.extend(views.extract_if(.., |view| is_double(view)).map(|view| view.name.into()));
    };
    take(&mut recognised.train, &mut recognised.missing);
    if let Some(test) = &mut recognised.test {
        take(test, &mut recognised.missing_test);
    }
}

fn read(folder: &Path, path: &Path) -> Result<Recognised> {
    let entries = std::fs::read_dir(folder)
        .map_err(|e| InputError::new(folder, "data set", e, "a readable folder"))?;
    let mut names: Vec<String> =
        entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.retain(|name| !lookup::is_hidden(name));
    names.sort();
    let has = |name: &str| names.iter().any(|n| n == name);
    let ends = |end: &str| names.iter().find(|n| n.ends_with(end));
    let named =
        |extension: &str| path.is_file() && path.extension().is_some_and(|e| e == extension);
    if named("json") {
        json(folder, path)
    } else if named("xml") {
        metashape::read(folder, path)
    } else if has("transforms_train.json") {
        json(folder, &folder.join("transforms_train.json"))
    } else if has("transforms.json") {
        json(folder, &folder.join("transforms.json"))
    } else if has("cameras_sphere.npz") {
        neus::read(folder, "cameras_sphere.npz")
    } else if has("cameras.npz") {
        neus::read(folder, "cameras.npz")
    } else if has("meta_data.json") {
        json(folder, &folder.join("meta_data.json"))
    } else if let Some(name) = ends("_par.txt") {
        middlebury::read(folder, &folder.join(name))
    } else if let Some(models) = colmap::models(folder) {
        colmap::read(folder, &models)
    } else if has("cameras.json") {
        json(folder, &folder.join("cameras.json"))
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

/// Reads a JSON camera file, whose content tells its form.
fn json(folder: &Path, file: &Path) -> Result<Recognised> {
    let root = files::json::read(file)?;
    if sdfstudio::is_form(&root) {
        sdfstudio::read(folder, file, &root)
    } else if splats::is_form(&root) {
        splats::read(folder, file, &root)
    } else {
        nerf::read(folder, file, &root)
    }
}
