//! NeuS/IDR data sets: `cameras_sphere.npz` with `image/` and `mask/` (Yariv et al., "Multiview
//! Neural Surface Reconstruction by Disentangling Geometry and Appearance", NeurIPS 2020; Wang et
//! al., "NeuS: Learning Neural Implicit Surfaces by Volume Rendering for Multi-view
//! Reconstruction", NeurIPS 2021).
//!
//! `world_mat_i` is the projection matrix of image i, OpenCV axes, pixel centres at integers.
//! `scale_mat_i` maps the unit sphere to the bounding sphere in world units.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use field::Sphere;
use glam::{DMat3, DMat4, DVec3};
use zip::ZipArchive;
use zip::result::ZipError;

use super::{Recognised, Result};
use crate::MaskKind;
use crate::projection::decompose;
use crate::unread::UnreadView;
use io::{InputError, image_size, refuse_unconverted};

/// The largest deviation of `scale_mat` from a uniform scale, relative to the squared scale.
const UNIFORM: f64 = 1e-4;

/// The part of an entry that is inflated, in bytes: the longest header, and 16 numbers.
const LARGEST_MATRIX: u64 = 12 + 10_000 + 16 * 8;

/// Reads the cameras and pairs them with the images in the order of their names.
pub(super) fn read(folder: &Path) -> Result<Recognised> {
    let mut archive = Archive::open(folder.join("cameras_sphere.npz"))?;
    let images = images(&folder.join("image"))?;
    archive.check_count(images.len())?;
    let masks = images_in(&folder.join("mask")).unwrap_or_default();
    let mut train = Vec::new();
    let mut bounds = None;
    for (i, path) in images.iter().enumerate() {
        let world = archive.matrix(&format!("world_mat_{i}"))?;
        let scale = archive.matrix(&format!("scale_mat_{i}"))?;
        bounds.get_or_insert(bounding_sphere(&archive.file, scale, i)?);
        let (width, height) = image_size(path)?;
        let (camera, lens) = decompose(world, width, height).ok_or_else(|| {
            let expected = "K [R t] with a regular K and a rotation R";
            InputError::new(&archive.file, format!("world_mat_{i}"), "a singular matrix", expected)
        })?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mask = mask_of(&images, i, &masks).map(|mask| (MaskKind::Object, mask));
        let size_source = "the image".to_owned();
        train.push(UnreadView { name, path: path.clone(), mask, camera, lens, size_source });
    }
    let format =
        "NeuS/IDR cameras_sphere.npz: P = world_mat, OpenCV axes, integer pixel centres".to_owned();
    Ok(Recognised { format, train, test: None, bounds, points: Vec::new() })
}

/// The archive of camera matrices: one `.npy` file a matrix.
struct Archive {
    file: PathBuf,
    zip: ZipArchive<BufReader<File>>,
}

impl Archive {
    fn open(file: PathBuf) -> Result<Self> {
        let (opened, _) = io::open(&file, "archive", "a .npz archive")?;
        let zip = ZipArchive::new(BufReader::new(opened))
            .map_err(|e| InputError::new(&file, "archive", e, "a .npz archive"))?;
        Ok(Archive { file, zip })
    }

    /// Refuses an archive without exactly one `world_mat` an image.
    fn check_count(&self, images: usize) -> Result<()> {
        let names = self.zip.file_names().flatten();
        let cameras = names.filter(|name| is_numbered(name, "world_mat_")).count();
        if cameras == images {
            return Ok(());
        }
        let expected = format!("{images}, one for each image in image/");
        Err(InputError::new(&self.file, "world_mat_*", format!("{cameras} arrays"), expected))
    }

    /// A 4 × 4 matrix in single or double precision, stored by rows or by columns.
    fn matrix(&mut self, name: &str) -> Result<DMat4> {
        let error = |found: String| {
            InputError::new(&self.file, name, found, "a 4 x 4 matrix of finite floats")
        };
        let entry = match self.zip.by_name(&format!("{name}.npy")) {
            Err(ZipError::FileNotFound) => return Err(error("nothing".to_owned())),
            entry => entry.map_err(|e| error(e.to_string()))?,
        };
        let npy = io::npy_reader(entry.take(LARGEST_MATRIX)).map_err(|e| error(e.to_string()))?;
        let shape = npy.shape().to_vec();
        if shape != [4, 4] {
            return Err(error(format!("shape {shape:?}")));
        }
        let by_columns = npy.order() == npyz::Order::Fortran;
        let is_double = npy.dtype().descr().contains("f8");
        let numbers: std::io::Result<Vec<f64>> = if is_double {
            npy.into_vec()
        } else {
            npy.into_vec::<f32>().map(|v| v.into_iter().map(f64::from).collect())
        };
        let numbers = numbers.map_err(|e| error(e.to_string()))?;
        match <[f64; 16]>::try_from(numbers) {
            Ok(m) if m.iter().all(|v| v.is_finite()) => {
                let m = DMat4::from_cols_array(&m);
                Ok(if by_columns { m } else { m.transpose() })
            }
            _ => Err(error("a number that is not finite".to_owned())),
        }
    }
}

/// True for `{prefix}N.npy` with a decimal number N.
fn is_numbered(name: &str, prefix: &str) -> bool {
    let number = name.strip_prefix(prefix).and_then(|rest| rest.strip_suffix(".npy"));
    number.is_some_and(|rest| !rest.is_empty() && rest.bytes().all(|b| b.is_ascii_digit()))
}

/// The mask of image `i`: the one with its name if any mask has the name of an image, and else, if
/// there are as many masks as images, the one at its place.
fn mask_of(images: &[PathBuf], i: usize, masks: &[PathBuf]) -> Option<PathBuf> {
    let same_name = |image: &PathBuf| masks.iter().find(|m| m.file_stem() == image.file_stem());
    if images.iter().any(|image| same_name(image).is_some()) {
        return same_name(&images[i]).cloned();
    }
    masks.get(i).filter(|_| masks.len() == images.len()).cloned()
}

/// The images of a folder that must have some.
fn images(folder: &Path) -> Result<Vec<PathBuf>> {
    let images = images_in(folder)
        .map_err(|e| InputError::new(folder, "images", e, "a folder with images"))?;
    if images.is_empty() {
        refuse_unconverted(folder)?;
        return Err(InputError::new(folder, "images", "none", "PNG or JPEG files"));
    }
    Ok(images)
}

/// The PNG and JPEG files of a folder, in the order of their names.
fn images_in(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)?.flatten().map(|e| e.path()).collect();
    paths.retain(|p| {
        p.extension().is_some_and(|e| {
            ["png", "jpg", "jpeg"].contains(&e.to_string_lossy().to_lowercase().as_str())
        })
    });
    paths.sort();
    Ok(paths)
}

/// The image of the unit sphere under `scale_mat`, in world units. The image is a sphere only if
/// the matrix is a rotation, a uniform scale and a translation.
fn bounding_sphere(file: &Path, scale: DMat4, i: usize) -> Result<Sphere<f64>> {
    let axes = DMat3::from_mat4(scale);
    let radius = axes.x_axis.length();
    let deviation = axes.transpose() * axes - DMat3::from_diagonal(DVec3::splat(radius * radius));
    let largest = deviation.to_cols_array().into_iter().fold(0.0, |a: f64, v| a.max(v.abs()));
    if radius > 0.0 && largest <= UNIFORM * radius * radius {
        return Ok(Sphere { center: scale.w_axis.truncate(), radius });
    }
    let found = format!("columns {}, {}, {}", axes.x_axis, axes.y_axis, axes.z_axis);
    let expected = "a uniform scale above 0, and a translation";
    Err(InputError::new(file, format!("scale_mat_{i}"), found, expected))
}
