//! BlendedMVS and MVSNet data sets: `cams/*.txt` with `blended_images/` or `images/` (Yao et
//! al., "BlendedMVS: A Large-Scale Dataset for Generalized Multi-View Stereo Networks", CVPR 2020;
//! "MVSNet: Depth Inference for Unstructured Multi-View Stereo", ECCV 2018).
//!
//! A camera file has the word `extrinsic` and a 4 × 4 world-to-camera matrix by rows, then
//! `intrinsic` and K by rows, then a range of depths. Axes are x right, y down, z forward; the
//! film's origin is the image's top left corner.

use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DVec2, DVec3};

use crate::readers::lens::Lens;
use crate::readers::lookup::{entries, file_name, image_place};
use crate::readers::projection::{camera_to_world, is_none, placed};
use crate::readers::recognised::{Recognised, Views};
use crate::readers::result::Result;
use crate::readers::unread::UnreadView;
use files::InputError;
use film::image_size;
use render::Camera;

/// The end of the name of a camera file. Other files, `pair.txt` for example, may be beside it.
const CAMERA_FILE: &str = "_cam.txt";

/// The camera files of a data set, in the order of their names; `None` if there are none.
pub(crate) fn cameras(folder: &Path) -> Option<Vec<PathBuf>> {
    let is_camera = |path: &PathBuf| file_name(path).ends_with(CAMERA_FILE);
    let files: Vec<PathBuf> = entries(&folder.join("cams")).into_iter().filter(is_camera).collect();
    (!files.is_empty()).then_some(files)
}

/// Reads the camera files; an image has the name of its camera, without `_cam`.
pub(crate) fn read(folder: &Path, cameras: &[PathBuf]) -> Result<Recognised> {
    let blended = folder.join("blended_images");
    let images = if blended.is_dir() { blended } else { folder.join("images") };
    let mut views = Views::default();
    for file in cameras {
        let name = file.file_stem().unwrap_or_default().to_string_lossy();
        let name = name.strip_suffix("_cam").unwrap_or(&name).to_owned();
        let pose_and_k = CameraFile::read(file)?;
        let path = image_place(&images, &name);
        views.add(path, |path| {
            let found = pose_and_k.camera(file, image_size(&path)?)?;
            Ok(found.map(|(camera, scale, lens)| {
                UnreadView::of_image(name, path, camera, lens).with_pose_scale(scale)
            }))
        })?;
    }
    let format =
        "BlendedMVS cams: world-to-camera, OpenCV axes, origin at the image's top left corner";
    Ok(Recognised::new(format, views))
}

/// The numbers of a camera file.
struct CameraFile {
    extrinsic: Vec<f64>,
    intrinsic: Vec<f64>,
}

impl CameraFile {
    fn read(file: &Path) -> Result<Self> {
        let text = files::read_text(file, "file", "a readable text file")?;
        let mut words = text.split_whitespace();
        let mut matrix = |name: &str, count: usize| -> Result<Vec<f64>> {
            let expected = format!("the word {name} and {count} numbers");
            let error = |found: &str| InputError::new(file, name, found, &expected);
            match words.next() {
                Some(word) if word == name => {}
                other => return Err(error(other.unwrap_or("the file's end"))),
            }
            let number = |_| {
                let word = words.next().ok_or_else(|| error("the file's end"))?;
                word.parse().map_err(|_| error(word))
            };
            (0..count).map(number).collect()
        };
        Ok(CameraFile { extrinsic: matrix("extrinsic", 16)?, intrinsic: matrix("intrinsic", 9)? })
    }

    fn camera(
        &self,
        file: &Path,
        (width, height): (u32, u32),
    ) -> Result<Option<(Camera, f64, Lens)>> {
        let (m, k) = (&self.extrinsic, &self.intrinsic);
        let matrix =
            <[f64; 16]>::try_from(m.as_slice()).map_or(DMat4::NAN, |m| DMat4::from_cols_array(&m));
        // The axes of an inverse span space if its own do.
        if is_none(matrix.transpose()) {
            return Ok(None);
        }
        if m[12..] != [0.0, 0.0, 0.0, 1.0] {
            let found = format!("last row {:?}", &m[12..]);
            return Err(InputError::new(file, "extrinsic", found, "last row [0, 0, 0, 1]"));
        }
        let is_k = k.iter().all(|v| v.is_finite())
            && k[0] > 0.0
            && k[4] > 0.0
            && k[3] == 0.0
            && k[6..] == [0.0, 0.0, 1.0];
        if !is_k {
            let expected = "K = [fx, s, cx, 0, fy, cy, 0, 0, 1] with fx and fy above 0";
            return Err(InputError::new(file, "intrinsic", format!("{k:?}"), expected));
        }
        // The rows of R are the camera's axes.
        let row = |r: usize| DVec3::new(m[4 * r], m[4 * r + 1], m[4 * r + 2]);
        let axes = DMat3::from_cols(row(0), row(1), row(2));
        let eye = -(axes * DVec3::new(m[3], m[7], m[11]));
        let pose = camera_to_world(axes.x_axis, axes.y_axis, axes.z_axis, eye);
        let (focal, principal) = (DVec2::new(k[0], k[4]), DVec2::new(k[2], k[5]));
        let lens = Lens { skew: k[1], ..Lens::default() };
        let placed = placed([width, height], focal, principal, pose, |found| {
            let expected = "a rotation and a translation, world-to-camera";
            InputError::new(file, "extrinsic", found, expected)
        })?;
        Ok(placed.map(|(camera, scale)| (camera, scale, lens)))
    }
}
