//! Data sets of posed photographs.

mod background;
mod bounds;
mod colmap;
pub mod inspect;
mod lens;
mod middlebury;
mod nerf;
mod neus;
mod pending;
#[cfg(test)]
mod shared_tests;
mod split;
pub mod synth;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use field::Sphere;
use glam::{DMat3, DMat4, DVec3};
use rayon::prelude::*;

pub use background::Background;
pub use bounds::looks_away;
pub use bounds::{check_cameras, surroundings};

use film::Film;
use io::InputError;
use pending::Pending;
use render::Camera;

/// One posed photograph.
#[derive(Clone, Debug)]
pub struct View {
    /// The image's name in the data set, for messages and pictures.
    pub name: String,
    /// The image's file.
    pub path: PathBuf,
    /// The camera it was taken with.
    pub camera: Camera,
    /// The photograph, linear RGB; over black where it has an alpha channel.
    pub image: Film,
    /// Coverage in [0, 1] per pixel from an alpha channel or a mask folder, where there is one;
    /// row-major.
    pub mask: Option<Vec<f32>>,
}

/// A data set as dsdf understood it.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// The folder.
    pub path: PathBuf,
    /// The format and convention that were recognised, for people.
    pub format: String,
    /// Views to fit.
    pub train: Vec<View>,
    /// Held-out views, for evaluation only.
    pub test: Vec<View>,
    /// The bounding sphere, if the data set says (NeuS/IDR `scale_mat`).
    pub bounds: Option<Sphere<f64>>,
    /// Points of the scene's surfaces, where the data set has some (COLMAP); else empty.
    pub points: Vec<DVec3>,
}

/// How to read a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoadOptions {
    /// Images are read at 1/downscale of their size.
    pub downscale: u32,
}

impl Default for LoadOptions {
    fn default() -> Self {
        LoadOptions { downscale: 1 }
    }
}

/// What a format's reader found.
struct Found {
    format: String,
    train: Vec<Pending>,
    /// `None` if the format has no split of its own.
    test: Option<Vec<Pending>>,
    bounds: Option<Sphere<f64>>,
    points: Vec<DVec3>,
}

/// Reads a data set, recognising its format: NeRF/Blender, NeuS/IDR, Middlebury or COLMAP.
///
/// `path` is the folder or a camera file in it. Views come in the order of the camera file (COLMAP:
/// of their names). Lens distortion and skew are removed from the photographs: every view is a
/// pinhole's.
///
/// # Errors
/// If no format is recognised, or a file is missing or wrong: an [`InputError`] that names the file
/// and the place in it.
pub fn load(path: &Path, options: &LoadOptions) -> anyhow::Result<Dataset> {
    if options.downscale == 0 {
        return Err(InputError::new(path, "downscale", 0, "1 or more").into());
    }
    let folder = match path.parent().filter(|_| path.is_file()) {
        Some(parent) if parent.as_os_str().is_empty() => Path::new("."),
        Some(parent) => parent,
        None => path,
    };
    let found = recognise(folder, path)?;
    let (train, test) = match found.test {
        Some(test) => (found.train, test),
        None => split::every_eighth(found.train),
    };
    if train.is_empty() {
        return Err(InputError::new(path, "views", "none to fit", "two photographs or more").into());
    }
    let read = |pending: Vec<Pending>| -> Result<Vec<View>, InputError> {
        // The first error in the order of the views, whichever thread met one first.
        let views: Vec<_> = pending.into_par_iter().map(|p| p.read(options.downscale)).collect();
        views.into_iter().collect()
    };
    Ok(Dataset {
        path: path.to_owned(),
        format: found.format,
        train: read(train)?,
        test: read(test)?,
        bounds: found.bounds,
        points: found.points,
    })
}

fn recognise(folder: &Path, path: &Path) -> Result<Found, InputError> {
    let entries = std::fs::read_dir(folder)
        .map_err(|e| InputError::new(folder, "data set", e, "a readable folder"))?;
    let names: Vec<String> =
        entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    let has = |name: &str| names.iter().any(|n| n == name);
    if path.is_file() && path.extension().is_some_and(|e| e == "json") {
        nerf::read(folder, &[path.to_owned()])
    } else if has("transforms_train.json") {
        nerf::read(folder, &[folder.join("transforms_train.json")])
    } else if has("transforms.json") {
        nerf::read(folder, &[folder.join("transforms.json")])
    } else if has("cameras_sphere.npz") {
        neus::read(folder)
    } else if let Some(name) = names.iter().filter(|n| n.ends_with("_par.txt")).min() {
        middlebury::read(folder, &folder.join(name))
    } else if let Some(model) = colmap::model_folder(folder) {
        colmap::read(&model)
    } else {
        let expected = "transforms_train.json, transforms.json, cameras_sphere.npz, *_par.txt or a COLMAP model (cameras.bin or .txt)";
        Err(InputError::new(folder, "data set", "no camera file", expected))
    }
}

/// What is wrong with the upper 3 × 3 of a pose that is no rotation, for messages.
fn pose_fault(pose: DMat4) -> String {
    if !pose.is_finite() {
        return "a number that is not finite".to_owned();
    }
    let rotation = DMat3::from_mat4(pose);
    let lengths = [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(|c| c.length());
    let [x, y, z] = lengths;
    format!(
        "columns of length {x:.4}, {y:.4}, {z:.4} and determinant {:.4}",
        rotation.determinant()
    )
}
