//! COLMAP sparse models, text and binary, with their images (Schönberger and Frahm,
//! "Structure-from-Motion Revisited", CVPR 2016; COLMAP's documentation, "Output Format" and
//! "Camera Models").
//!
//! A pose is world-to-camera with axes x right, y down, z forward. Film coordinates have their
//! origin at the image's top left corner, as those of [`Camera`].

mod binary;
mod model;
mod models;
mod records;
mod summary;
mod text;

pub(crate) use models::models;
pub use summary::{SparseCamera, SparseModel, sparse_model};

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};

use crate::readers::images::{ImageFolder, image_folder};
use crate::readers::lens::Lens;
use crate::readers::lookup::{image_named, image_place};
use crate::readers::projection::{camera_to_world, placed};
use crate::readers::recognised::{Recognised, Views};
use crate::readers::result::Result;
use crate::readers::unread::UnreadView;
use files::InputError;
use model::Model;
use models::Candidates;
use records::{CameraRecord, ImageRecord, PointRecord};
use render::Camera;

/// The camera models that a pinhole and a [`Lens`] describe.
const SUPPORTED: [&str; 10] = [
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "FULL_OPENCV",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "OPENCV_FISHEYE",
    "THIN_PRISM_FISHEYE",
];

/// The largest deviation of a quaternion's length from 1.
const UNIT: f64 = 1e-3;

/// Reads the model with the most images. Its images are in `images/` or `input/`, or else in a
/// reduced copy of these, in the model's folder or up to three folders above.
pub(crate) fn read(data_set: &Path, candidates: &[PathBuf]) -> Result<Recognised> {
    let Candidates { folder, images, note } = models::largest(data_set, candidates)?;
    let model = Model::in_folder(&folder);
    let cameras = model.cameras()?;
    let cameras: Result<BTreeMap<u32, (Camera, Lens)>> = cameras
        .iter()
        .map(|record| intrinsics(&model.cameras, record).map(|camera| (record.id, camera)))
        .collect();
    let cameras = cameras?;
    if images.is_empty() {
        return Err(InputError::new(&model.images, "images", "none", "registered images"));
    }
    let place = folder_of_images(&folder, &images)?;
    let mut views = Views::default();
    for image in images {
        views.add(image_place(&place.path, &image.name), |path| {
            let view = unread_view(&model.images, path, &cameras, image)?;
            if place.is_reduced {
                view.map(UnreadView::of_reduced_image).transpose()
            } else {
                Ok(view)
            }
        })?;
    }
    // COLMAP numbers images in no particular order.
    views.found.sort_by(|a, b| a.name.cmp(&b.name));
    views.missing.sort();
    let format = format!(
        "COLMAP sparse model ({}): world-to-camera, OpenCV axes",
        if model.binary { "binary" } else { "text" }
    );
    let notes = note.into_iter().collect();
    let points = model.points()?;
    // Points of a `.ply` file have no tracks that could vouch for them.
    let has_tracks = points.iter().any(|point| point.views > 0);
    let is_sure = points.iter().filter(|_| has_tracks).map(PointRecord::is_sure).collect();
    let points = points.iter().map(|point| point.position).collect();
    let used_by_extension = true;
    Ok(Recognised { points, is_sure, notes, used_by_extension, ..Recognised::new(&format, views) })
}

/// The folder of the images: the first that has one of them.
fn folder_of_images(model: &Path, images: &[ImageRecord]) -> Result<ImageFolder> {
    let places: Vec<&Path> = model.ancestors().take(4).collect();
    let has = |folder: &Path| images.iter().any(|image| image_named(folder, &image.name).is_some());
    image_folder(&places, has).ok_or_else(|| {
        let expected = "a folder \"images\" or \"input\" beside the model's folder or \"sparse\"";
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
    let (radial, fisheye) = (Lens::radial, Lens::fisheye);
    Ok(match (record.model.as_str(), record.parameters.as_slice()) {
        ("SIMPLE_PINHOLE", &[f, x, y]) => ([f, f], [x, y], Lens::default()),
        ("PINHOLE", &[fx, fy, x, y]) => ([fx, fy], [x, y], Lens::default()),
        ("SIMPLE_RADIAL", &[f, x, y, k]) => ([f, f], [x, y], radial([k, 0.0, 0.0, 0.0])),
        ("RADIAL", &[f, x, y, k1, k2]) => ([f, f], [x, y], radial([k1, k2, 0.0, 0.0])),
        ("OPENCV", &[fx, fy, x, y, k1, k2, p1, p2]) => {
            let lens = Lens { tangential: [p1, p2], ..radial([k1, k2, 0.0, 0.0]) };
            ([fx, fy], [x, y], lens)
        }
        ("FULL_OPENCV", &[fx, fy, x, y, k1, k2, p1, p2, k3, k4, k5, k6]) => {
            let radial = radial([k1, k2, k3, 0.0]);
            let lens = Lens { tangential: [p1, p2], divisor: [k4, k5, k6], ..radial };
            ([fx, fy], [x, y], lens)
        }
        ("SIMPLE_RADIAL_FISHEYE", &[f, x, y, k]) => ([f, f], [x, y], fisheye([k, 0.0, 0.0, 0.0])),
        ("RADIAL_FISHEYE", &[f, x, y, k1, k2]) => ([f, f], [x, y], fisheye([k1, k2, 0.0, 0.0])),
        ("OPENCV_FISHEYE", &[fx, fy, x, y, k1, k2, k3, k4]) => {
            ([fx, fy], [x, y], fisheye([k1, k2, k3, k4]))
        }
        ("THIN_PRISM_FISHEYE", &[fx, fy, x, y, k1, k2, p1, p2, k3, k4, s1, s2]) => {
            let fisheye = fisheye([k1, k2, k3, k4]);
            ([fx, fy], [x, y], Lens { tangential: [p1, p2], prism: [s1, s2], ..fisheye })
        }
        (model, p) if SUPPORTED.contains(&model) => {
            let found = format!("{} parameters of {model}", p.len());
            return Err(InputError::new(file, place, found, "as many as the camera model has"));
        }
        (other, _) => {
            let supported = SUPPORTED.join(", ");
            let expected = format!("{supported} (others: undistort the images with COLMAP)");
            return Err(InputError::new(file, format!("{place} model"), other, expected));
        }
    })
}

/// The view of an image record, `None` without a usable pose; `file` is the file of the record, and
/// `path` that of the image.
fn unread_view(
    file: &Path,
    path: PathBuf,
    cameras: &BTreeMap<u32, (Camera, Lens)>,
    image: ImageRecord,
) -> Result<Option<UnreadView>> {
    let size_source = format!("camera {}", image.camera);
    let (camera, lens) = cameras.get(&image.camera).ok_or_else(|| {
        InputError::new(file, &image.name, &size_source, "a camera that the model has")
    })?;
    let Camera { width, height, focal, principal, .. } = *camera;
    let pose = pose(file, &image)?;
    let wrong = |found| {
        let place = format!("pose of {}", image.name);
        InputError::new(file, place, found, "a rotation and a translation")
    };
    let placed = placed([width, height], focal, principal, pose, wrong)?;
    let Some((camera, _)) = placed else { return Ok(None) };
    Ok(Some(UnreadView {
        size_source: Some(size_source),
        ..UnreadView::of_image(image.name, path, camera, *lens)
    }))
}

/// The camera-to-world matrix of an image record; NaN if a number is not finite, or the quaternion
/// is 0.
fn pose(file: &Path, image: &ImageRecord) -> Result<DMat4> {
    let [w, x, y, z] = image.quaternion;
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let length = quaternion.length();
    if !length.is_finite() || length == 0.0 || !image.translation.is_finite() {
        return Ok(DMat4::NAN);
    }
    if (length - 1.0).abs() > UNIT {
        let found = format!("quaternion {:?}, translation {}", image.quaternion, image.translation);
        let expected = "a unit quaternion (w, x, y, z) and a finite translation";
        return Err(InputError::new(file, format!("pose of {}", image.name), found, expected));
    }
    let axes = DMat3::from_quat(quaternion / length).transpose();
    let eye = -(axes * image.translation);
    Ok(camera_to_world(axes.x_axis, axes.y_axis, axes.z_axis, eye))
}
