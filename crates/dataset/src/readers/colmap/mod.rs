//! COLMAP sparse models, text and binary, with their images (Schönberger and Frahm,
//! "Structure-from-Motion Revisited", CVPR 2016; COLMAP's documentation, "Output Format" and
//! "Camera Models").
//!
//! A pose is world-to-camera with axes x right, y down, z forward. Film coordinates have their
//! origin at the image's top left corner, as those of [`Camera`].

mod binary;
#[cfg(test)]
mod tests;
mod text;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};

use super::{Recognised, Result};
use crate::MaskKind;
use crate::lens::Lens;
use crate::projection::{camera_to_world, pose_fault};
use crate::unread::UnreadView;
use io::InputError;
use render::Camera;

/// The camera models that a pinhole and a [`Lens`] describe.
const SUPPORTED: &str = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV \
     (others: undistort the images with COLMAP)";

/// The largest deviation of a quaternion's length from 1.
const UNIT: f64 = 1e-3;

/// A record of `cameras`: the camera model gives the parameters their meaning.
#[derive(Clone, Debug, PartialEq)]
struct CameraRecord {
    id: u32,
    model: String,
    /// Width and height in pixels.
    size: [u64; 2],
    parameters: Vec<f64>,
}

/// A record of `images`: an image and its world-to-camera pose.
#[derive(Clone, Debug, PartialEq)]
struct ImageRecord {
    /// (w, x, y, z).
    quaternion: [f64; 4],
    translation: DVec3,
    /// The id of its [`CameraRecord`].
    camera: u32,
    name: String,
}

/// The three files of a model, all text or all binary.
struct Model {
    binary: bool,
    cameras: PathBuf,
    images: PathBuf,
    points: PathBuf,
}

impl Model {
    /// If a folder has both forms, the binary one is read, as COLMAP does.
    fn in_folder(folder: &Path) -> Self {
        let binary = folder.join("cameras.bin").is_file();
        let extension = if binary { "bin" } else { "txt" };
        let [cameras, images, points] = ["cameras", "images", "points3D"]
            .map(|name| folder.join(format!("{name}.{extension}")));
        Model { binary, cameras, images, points }
    }

    fn cameras(&self) -> Result<Vec<CameraRecord>> {
        if self.binary { binary::cameras(&self.cameras) } else { text::cameras(&self.cameras) }
    }

    fn images(&self) -> Result<Vec<ImageRecord>> {
        if self.binary { binary::images(&self.images) } else { text::images(&self.images) }
    }

    /// The finite points; none if the file is missing.
    fn points(&self) -> Result<Vec<DVec3>> {
        let mut points = match self.points.is_file() {
            true if self.binary => binary::points(&self.points)?,
            true => text::points(&self.points)?,
            false => Vec::new(),
        };
        points.retain(|p| p.is_finite());
        Ok(points)
    }
}

/// The folder that holds the model of a data set: `sparse/0`, `sparse` or `folder` itself, the
/// first that has a camera file.
pub(super) fn model_folder(folder: &Path) -> Option<PathBuf> {
    let places = [folder.join("sparse/0"), folder.join("sparse"), folder.to_owned()];
    places
        .into_iter()
        .find(|p| ["cameras.bin", "cameras.txt"].iter().any(|name| p.join(name).is_file()))
}

/// Reads the model in `folder`. Its images are in `images/` of that folder, of its parent or of its
/// grandparent.
pub(super) fn read(folder: &Path) -> Result<Recognised> {
    let model = Model::in_folder(folder);
    let (cameras, images) = (model.cameras()?, model.images()?);
    let cameras: Result<BTreeMap<u32, (Camera, Lens)>> = cameras
        .iter()
        .map(|record| intrinsics(&model.cameras, record).map(|camera| (record.id, camera)))
        .collect();
    let cameras = cameras?;
    let image_folder = image_folder(folder)?;
    let train: Result<Vec<UnreadView>> = images
        .into_iter()
        .map(|image| unread_view(&model.images, &image_folder, &cameras, image))
        .collect();
    let mut train = train?;
    if train.is_empty() {
        return Err(InputError::new(&model.images, "images", "none", "registered images"));
    }
    // COLMAP numbers images in no particular order.
    train.sort_by(|a, b| a.name.cmp(&b.name));
    let format = format!(
        "COLMAP sparse model ({}): world-to-camera, OpenCV axes",
        if model.binary { "binary" } else { "text" }
    );
    Ok(Recognised { format, train, test: None, bounds: None, points: model.points()? })
}

fn image_folder(model: &Path) -> Result<PathBuf> {
    let candidates: Vec<PathBuf> = model.ancestors().take(3).map(|p| p.join("images")).collect();
    candidates.iter().find(|p| p.is_dir()).cloned().ok_or_else(|| {
        let expected = "a folder \"images\" beside the model's folder or \"sparse\"";
        InputError::new(model, "images", "no such folder", expected)
    })
}

/// The intrinsics of a record: a camera at the origin and its lens.
fn intrinsics(file: &Path, record: &CameraRecord) -> Result<(Camera, Lens)> {
    let place = format!("camera {}", record.id);
    let (focal, principal, lens) = parameters(file, &place, record)?;
    let p = &record.parameters;
    if p.iter().any(|v| !v.is_finite()) || focal.iter().any(|f| *f <= 0.0) {
        let expected = "finite parameters and focal lengths above 0";
        return Err(InputError::new(file, place, format!("{p:?}"), expected));
    }
    let [width, height] =
        record.size.map(|n| u32::try_from(n).ok().filter(|n| (1..=1 << 16).contains(n)));
    let (Some(width), Some(height)) = (width, height) else {
        let found = format!("size {:?}", record.size);
        return Err(InputError::new(file, place, found, "a width and height from 1 to 65536"));
    };
    let (eye, right, up, forward) = (DVec3::ZERO, DVec3::X, DVec3::Y, -DVec3::Z);
    let (focal, principal) = (DVec2::from(focal), DVec2::from(principal));
    let radial = DVec2::ZERO;
    Ok((Camera { width, height, focal, principal, eye, right, up, forward, radial }, lens))
}

/// Focal lengths, principal point and lens, by the camera model.
fn parameters(
    file: &Path,
    place: &str,
    record: &CameraRecord,
) -> Result<([f64; 2], [f64; 2], Lens)> {
    let lens = |radial, tangential| Lens { radial, tangential, skew: 0.0 };
    Ok(match (record.model.as_str(), record.parameters.as_slice()) {
        ("SIMPLE_PINHOLE", &[f, x, y]) => ([f, f], [x, y], Lens::default()),
        ("PINHOLE", &[fx, fy, x, y]) => ([fx, fy], [x, y], Lens::default()),
        ("SIMPLE_RADIAL", &[f, x, y, k]) => ([f, f], [x, y], lens([k, 0.0], [0.0; 2])),
        ("RADIAL", &[f, x, y, k1, k2]) => ([f, f], [x, y], lens([k1, k2], [0.0; 2])),
        ("OPENCV", &[fx, fy, x, y, k1, k2, p1, p2]) => ([fx, fy], [x, y], lens([k1, k2], [p1, p2])),
        ("SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV", p) => {
            let found = format!("{} parameters of {}", p.len(), record.model);
            return Err(InputError::new(file, place, found, "as many as the camera model has"));
        }
        (other, _) => {
            return Err(InputError::new(file, format!("{place} model"), other, SUPPORTED));
        }
    })
}

/// The view of an image record; `file` is the file of the record.
fn unread_view(
    file: &Path,
    image_folder: &Path,
    cameras: &BTreeMap<u32, (Camera, Lens)>,
    image: ImageRecord,
) -> Result<UnreadView> {
    let size_source = format!("camera {}", image.camera);
    let (camera, lens) = cameras.get(&image.camera).ok_or_else(|| {
        InputError::new(file, &image.name, &size_source, "a camera that the model has")
    })?;
    let Camera { width, height, focal, principal, .. } = *camera;
    let pose = pose(file, &image)?;
    let camera = Camera::from_pose(width, height, focal, principal, pose).ok_or_else(|| {
        let place = format!("pose of {}", image.name);
        InputError::new(file, place, pose_fault(pose), "a rotation and a translation")
    })?;
    let path = image_folder.join(&image.name);
    let mask = mask_of(image_folder, &image.name);
    Ok(UnreadView { name: image.name, path, mask, camera, lens: *lens, size_source })
}

/// The camera-to-world matrix of an image record.
fn pose(file: &Path, image: &ImageRecord) -> Result<DMat4> {
    let [w, x, y, z] = image.quaternion;
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let length = quaternion.length();
    // Not `> UNIT`: NaN is refused too.
    if !(length - 1.0).abs().le(&UNIT) || !image.translation.is_finite() {
        let found = format!("quaternion {:?}, translation {}", image.quaternion, image.translation);
        let expected = "a unit quaternion (w, x, y, z) and a finite translation";
        return Err(InputError::new(file, format!("pose of {}", image.name), found, expected));
    }
    let axes = DMat3::from_quat(quaternion / length).transpose();
    let eye = -(axes * image.translation);
    Ok(camera_to_world(axes.x_axis, axes.y_axis, axes.z_axis, eye))
}

/// The mask of `images/a.jpg`: `masks/a.jpg.png`, COLMAP's own naming, tells which pixels to use;
/// `masks/a.png` or `masks/a.jpg` is a mask of the object.
fn mask_of(image_folder: &Path, name: &str) -> Option<(MaskKind, PathBuf)> {
    let masks = image_folder.parent()?.join("masks");
    let stem = Path::new(name).with_extension("png");
    let places = [
        (MaskKind::Used, masks.join(format!("{name}.png"))),
        (MaskKind::Object, masks.join(stem)),
        (MaskKind::Object, masks.join(name)),
    ];
    places.into_iter().find(|(_, path)| path.is_file())
}
