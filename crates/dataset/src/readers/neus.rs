//! NeuS/IDR data sets: `cameras_sphere.npz`, or IDR's `cameras.npz`, with `image/` and `mask/`
//! (Yariv et al., "Multiview Neural Surface Reconstruction by Disentangling Geometry and
//! Appearance", NeurIPS 2020; Wang et al., "NeuS: Learning Neural Implicit Surfaces by Volume
//! Rendering for Multi-view Reconstruction", NeurIPS 2021).
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

use crate::readers::images::{by_number, images, images_in, positions};
use crate::readers::lookup::folder_named;
use crate::readers::projection::decompose;
use crate::readers::recognised::{Recognised, Views};
use crate::readers::result::Result;
use crate::readers::unread::UnreadView;
use files::InputError;
use film::image_size;

/// The largest deviation of `scale_mat` from a uniform scale, relative to the squared scale.
const UNIFORM: f64 = 1e-4;

/// The part of an entry that is inflated, in bytes: the longest header, and 16 numbers.
const LARGEST_MATRIX: u64 = 12 + 10_000 + 16 * 8;

/// Reads the cameras of the archive `name`, and pairs them with the images in the order of their
/// names; by the numbers in the names if images are missing.
pub(crate) fn read(folder: &Path, name: &str) -> Result<Recognised> {
    let mut archive = Archive::open(folder.join(name))?;
    let place = |name| folder_named(folder, name).unwrap_or_else(|| folder.join(name));
    let mut images = images(&place("image"))?;
    let note = by_number(&mut images);
    let mut masks = images_in(&place("mask")).unwrap_or_default();
    by_number(&mut masks);
    let cameras = archive.cameras_of(&images, &masks)?;
    let mut views = Views::default();
    let mut bounds = None;
    for (path, camera) in images.iter().zip(&cameras) {
        let world = archive.matrix(&format!("world_mat_{camera}"))?;
        let scale = archive.matrix(&format!("scale_mat_{camera}"))?;
        bounds.get_or_insert(bounding_sphere(&archive.file, scale, *camera)?);
        let (width, height) = image_size(path)?;
        // A matrix that is singular or not finite is no pose.
        let Some((camera, lens)) = decompose(world, width, height) else {
            views.unposed.push(path.clone());
            continue;
        };
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        views.found.push(UnreadView::of_image(name, path.clone(), camera, lens));
    }
    let missing = (0..archive.cameras()).filter(|i| !cameras.contains(i));
    views.missing = missing.map(|i| folder.join("image").join(format!("{i:03}"))).collect();
    let format = format!("NeuS/IDR {name}: P = world_mat, OpenCV axes, integer pixel centres");
    let notes = note.into_iter().collect();
    Ok(Recognised { bounds, notes, pairs_by_order: true, ..Recognised::new(&format, views) })
}

/// The archive of camera matrices: one `.npy` file a matrix.
struct Archive {
    file: PathBuf,
    zip: ZipArchive<BufReader<File>>,
}

impl Archive {
    fn open(file: PathBuf) -> Result<Self> {
        let (opened, _) = files::open(&file, "archive", "a .npz archive")?;
        let zip = ZipArchive::new(BufReader::new(opened))
            .map_err(|e| InputError::new(&file, "archive", e, "a .npz archive"))?;
        Ok(Archive { file, zip })
    }

    /// The number of cameras.
    fn cameras(&self) -> usize {
        let names = self.zip.file_names().flatten();
        names.filter(|name| is_numbered(name, "world_mat_")).count()
    }

    /// The index of the camera of each image. If images are missing, the masks tell it by their
    /// names if there is one a camera, and else the numbers in the names of the images.
    fn cameras_of(&self, images: &[PathBuf], masks: &[PathBuf]) -> Result<Vec<usize>> {
        let count = self.cameras();
        let mask_of =
            |image: &PathBuf| masks.iter().position(|m| m.file_stem() == image.file_stem());
        let by_mask = || images.iter().map(mask_of).collect::<Option<Vec<usize>>>();
        let cameras = match images.len() < count && masks.len() == count {
            true => by_mask().or_else(|| positions(images, count)),
            false => positions(images, count),
        };
        cameras.filter(|cameras| cameras.len() <= count).ok_or_else(|| {
            let expected = format!(
                "{}, one for each image in image/ (or images numbered from 0)",
                images.len()
            );
            InputError::new(&self.file, "world_mat_*", format!("{count} arrays"), expected)
        })
    }

    /// A 4 × 4 matrix of floats, stored by rows or by columns.
    fn matrix(&mut self, name: &str) -> Result<DMat4> {
        let error = |found: String| {
            InputError::new(&self.file, name, found, "a 4 x 4 matrix of finite floats")
        };
        let entry = match self.zip.by_name(&format!("{name}.npy")) {
            Err(ZipError::FileNotFound) => return Err(error("nothing".to_owned())),
            entry => entry.map_err(|e| error(e.to_string()))?,
        };
        let npy = film::npy_reader(entry.take(LARGEST_MATRIX)).map_err(|e| error(e.to_string()))?;
        let shape = npy.shape().to_vec();
        if shape != [4, 4] {
            return Err(error(format!("shape {shape:?}")));
        }
        let numbers = film::npy_numbers(npy).map_err(|e| error(e.to_string()))?;
        match <[f64; 16]>::try_from(numbers) {
            Ok(m) => Ok(DMat4::from_cols_array(&m).transpose()),
            Err(_) => Err(error("another number of floats".to_owned())),
        }
    }
}

/// True for `{prefix}N.npy` with a decimal number N.
fn is_numbered(name: &str, prefix: &str) -> bool {
    let number = name.strip_prefix(prefix).and_then(|rest| rest.strip_suffix(".npy"));
    number.is_some_and(|rest| !rest.is_empty() && rest.bytes().all(|b| b.is_ascii_digit()))
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
