//! Data sets of posed photographs.

mod background;
mod bounds;
mod middlebury;
mod nerf;
mod neus;
mod split;

use std::path::{Path, PathBuf};

use field::Sphere;
use rayon::prelude::*;

pub use background::Background;
pub use bounds::{check_cameras, surroundings};

use crate::camera::Camera;
use crate::error::InputError;
use crate::film::Film;
use crate::io::read_image;

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
    /// Coverage in [0, 1] per pixel from an alpha channel or a mask folder, where there is one; row-major.
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

/// A view whose image is still to be read.
struct Pending {
    name: String,
    path: PathBuf,
    /// A mask image of its own, where there is one.
    mask: Option<PathBuf>,
    camera: Camera,
    /// The JSON key, line or array that the camera's size came from, for messages.
    size_from: String,
}

/// What a format's reader found.
struct Found {
    format: String,
    train: Vec<Pending>,
    /// `None` if the format has no split of its own.
    test: Option<Vec<Pending>>,
    bounds: Option<Sphere<f64>>,
}

/// Reads a data set, recognising its format: NeRF/Blender, NeuS/IDR or Middlebury.
///
/// # Errors
/// If no format is recognised, or a file is missing or wrong.
pub fn load(path: &Path, options: &LoadOptions) -> anyhow::Result<Dataset> {
    let folder = if path.is_file() { path.parent().unwrap_or(path) } else { path };
    let found = recognise(folder, path)?;
    let (train, test) = match found.test {
        Some(test) => (found.train, test),
        None => split::every_eighth(found.train),
    };
    if train.is_empty() {
        return Err(InputError::new(path, "views", "none to fit", "two photographs or more").into());
    }
    let read = |pending: Vec<Pending>| -> Result<Vec<View>, InputError> {
        pending.into_par_iter().map(|p| read_view(p, options.downscale)).collect()
    };
    Ok(Dataset {
        path: path.to_owned(),
        format: found.format,
        train: read(train)?,
        test: read(test)?,
        bounds: found.bounds,
    })
}

fn recognise(folder: &Path, path: &Path) -> Result<Found, InputError> {
    let entries = std::fs::read_dir(folder).map_err(|e| InputError::new(folder, "data set", e, "a readable folder"))?;
    let names: Vec<String> = entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
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
    } else {
        let expected = "transforms_train.json, transforms.json, cameras_sphere.npz or *_par.txt";
        Err(InputError::new(folder, "data set", "no camera file", expected))
    }
}

/// Reads one view's image and mask, at the size asked for.
fn read_view(pending: Pending, downscale: u32) -> Result<View, InputError> {
    let Pending { name, path, mask, camera, size_from } = pending;
    let (image, alpha) = read_image(&path)?;
    if (image.width, image.height) != (camera.width, camera.height) {
        let expected = format!("{} x {}, as {size_from} says", camera.width, camera.height);
        return Err(InputError::new(&path, "size", format!("{} x {}", image.width, image.height), expected));
    }
    let mask = match (alpha.is_some(), mask) {
        (false, Some(path)) => Some(read_mask(&path, &camera)?),
        _ => None,
    };
    // The colour under a transparent pixel means nothing: over black, transparency is part of the photograph.
    let image = match &alpha {
        Some(alpha) => {
            Film { pixels: image.pixels.iter().zip(alpha).map(|(p, a)| p.map(|c| c * a)).collect(), ..image }
        }
        None => image,
    };
    let mask = alpha.or(mask);
    if downscale == 1 {
        return Ok(View { name, path, camera, image, mask });
    }
    let small = image.downscaled(downscale);
    let mask = mask.map(|mask| {
        let film = Film { width: image.width, height: image.height, pixels: mask.iter().map(|&m| [m; 3]).collect() };
        film.downscaled(downscale).pixels.iter().map(|p| p[0]).collect()
    });
    let scale = f64::from(downscale);
    let (focal, principal) = (camera.focal / scale, camera.principal / scale);
    let camera = Camera { width: small.width, height: small.height, focal, principal, ..camera };
    Ok(View { name, path, camera, image: small, mask })
}

/// A mask image: white is the object.
fn read_mask(path: &Path, camera: &Camera) -> Result<Vec<f32>, InputError> {
    let (mask, _) = read_image(path)?;
    if (mask.width, mask.height) != (camera.width, camera.height) {
        let expected = format!("{} x {}, as the photograph", camera.width, camera.height);
        return Err(InputError::new(path, "size", format!("{} x {}", mask.width, mask.height), expected));
    }
    // Masks are coverage, not light: the transfer function is taken back.
    Ok(mask.pixels.iter().map(|p| crate::film::srgb_encode(p[0])).collect())
}
