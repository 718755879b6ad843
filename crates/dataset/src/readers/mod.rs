//! The camera files of other programs, one module a format, and lenses.

#![warn(clippy::cast_possible_truncation)]

mod blended_mvs;
mod colmap;
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
mod ply;
mod projection;
mod unread;
mod unsupported;
mod view;

pub use colmap::{SparseCamera, SparseModel, sparse_model};
pub use lens::Distortion;
pub use mask::{ALL_USED, Mask, MaskKind};
pub use unread::UnreadView;
pub use view::View;

use std::path::{Path, PathBuf};

use field::Sphere;
use files::InputError;
use film::refuse_unconverted;
use glam::DVec3;

type Result<T> = std::result::Result<T, InputError>;

/// The width or the height of an image, in pixels, if the number is whole and from 1 to 65535.
fn whole_pixels(number: f64) -> Option<u32> {
    #[expect(clippy::cast_possible_truncation, reason = "the number is compared with the result")]
    let whole = number as u16;
    (whole > 0 && f64::from(whole) == number).then_some(whole.into())
}

/// The content of a data set before its images are read.
#[derive(Debug, Default)]
pub struct Recognised {
    /// The format and camera convention, as text.
    pub format: String,
    /// Views to fit.
    pub train: Vec<UnreadView>,
    /// Held-out views; `None` if the data set has no split of its own.
    pub test: Option<Vec<UnreadView>>,
    /// The bounding sphere, if the data set has one.
    pub bounds: Option<Sphere<f64>>,
    /// Points on the scene's surfaces, if the data set has any.
    pub points: Vec<DVec3>,
    /// One sentence for each thing that a user should know: images that are missing, models that
    /// are not read, photographs that are cut.
    pub notes: Vec<String>,
    /// Images that the camera file names and that do not exist, but for those in `missing_test`.
    missing: Vec<PathBuf>,
    /// The same, of the views to hold out.
    missing_test: Vec<PathBuf>,
}

impl Recognised {
    /// A data set of these views, without a split.
    fn new(format: &str, views: Views) -> Self {
        let Views { found, missing } = views;
        Recognised { format: format.to_owned(), train: found, missing, ..Recognised::default() }
    }
}

/// The views of a camera file whose images exist, and the images that do not.
#[derive(Default)]
struct Views {
    found: Vec<UnreadView>,
    missing: Vec<PathBuf>,
}

impl Views {
    /// Adds the view of an image, or the image to the missing ones.
    ///
    /// # Errors
    /// Those of `view`, and if a HEIF file is in the place of the image.
    fn add(
        &mut self,
        image: PathBuf,
        view: impl FnOnce(PathBuf) -> Result<UnreadView>,
    ) -> Result<()> {
        if image.exists() {
            self.found.push(view(image)?);
        } else {
            refuse_unconverted(&image)?;
            self.missing.push(image);
        }
        Ok(())
    }
}

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
