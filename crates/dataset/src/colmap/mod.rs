//! COLMAP sparse models, text and binary, with their images.
//!
//! Source: COLMAP's documentation, "Output Format" and "Camera Models". Poses are world-to-camera
//! with axes x right, y down, z forward; film coordinates have their origin at the image's top left
//! corner, as ours.

mod binary;
#[cfg(test)]
mod tests;
mod text;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::lens::Lens;
use super::neus::camera_to_world;
use super::{Found, Pending, pose_fault};
use io::InputError;
use render::Camera;

type Result<T> = std::result::Result<T, InputError>;

/// The camera models that a pinhole and [`Lens`] describe.
const SUPPORTED: &str = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV (others: undistort the images with COLMAP)";

/// A camera as the model has it: `parameters` mean what `model` says.
#[derive(Clone, Debug, PartialEq)]
struct Intrinsics {
    id: u32,
    model: String,
    size: [u64; 2],
    parameters: Vec<f64>,
}

/// An image with its pose, world to camera; the quaternion is (w, x, y, z).
#[derive(Clone, Debug, PartialEq)]
struct Registered {
    quaternion: [f64; 4],
    translation: DVec3,
    camera: u32,
    name: String,
}

/// The folder that holds the model of a data set: `sparse/0`, `sparse` or `folder` itself.
pub(super) fn model_folder(folder: &Path) -> Option<PathBuf> {
    let places = [folder.join("sparse/0"), folder.join("sparse"), folder.to_owned()];
    places
        .into_iter()
        .find(|p| ["cameras.bin", "cameras.txt"].iter().any(|name| p.join(name).is_file()))
}

/// Reads the model in `model`; images are looked for in `images/` there and in the folders above,
/// as far as `sparse`'s.
pub(super) fn read(model: &Path) -> Result<Found> {
    // Where both forms are there, COLMAP prefers the binary one.
    let binary = model.join("cameras.bin").is_file();
    let extension = if binary { "bin" } else { "txt" };
    let [cameras_file, images_file, points_file] =
        ["cameras", "images", "points3D"].map(|name| model.join(format!("{name}.{extension}")));
    let (cameras, images) = if binary {
        (binary::cameras(&cameras_file)?, binary::images(&images_file)?)
    } else {
        (text::cameras(&cameras_file)?, text::images(&images_file)?)
    };
    let cameras = intrinsics(&cameras_file, &cameras)?;
    let folder = images_folder(model)?;
    let train: Result<Vec<Pending>> =
        images.into_iter().map(|image| pending(&images_file, &folder, &cameras, image)).collect();
    let mut train = train?;
    if train.is_empty() {
        return Err(InputError::new(&images_file, "images", "none", "registered images"));
    }
    // The numbers of images mean nothing; their names do.
    train.sort_by(|a, b| a.name.cmp(&b.name));
    let points = match points_file.is_file() {
        true if binary => binary::points(&points_file)?,
        true => text::points(&points_file)?,
        false => Vec::new(),
    };
    let format = format!(
        "COLMAP sparse model ({}): world-to-camera, OpenCV axes",
        if binary { "binary" } else { "text" }
    );
    Ok(Found {
        format,
        train,
        test: None,
        bounds: None,
        points: points.into_iter().filter(|p| p.is_finite()).collect(),
    })
}

fn images_folder(model: &Path) -> Result<PathBuf> {
    let above: Vec<PathBuf> = model.ancestors().take(3).map(|p| p.join("images")).collect();
    above.iter().find(|p| p.is_dir()).cloned().ok_or_else(|| {
        let expected = "a folder \"images\" beside the model's folder or \"sparse\"";
        InputError::new(model, "images", "no such folder", expected)
    })
}

/// A camera at the origin for each number, the lens before it, and the line that says so.
fn intrinsics(file: &Path, cameras: &[Intrinsics]) -> Result<BTreeMap<u32, (Camera, Lens)>> {
    cameras.iter().map(|c| pinhole(file, c).map(|camera| (c.id, camera))).collect()
}

fn pinhole(file: &Path, camera: &Intrinsics) -> Result<(Camera, Lens)> {
    let at = format!("camera {}", camera.id);
    let p = &camera.parameters;
    let lens = |radial, tangential| Lens { radial, tangential, skew: 0.0 };
    let (focal, principal, lens) = match (camera.model.as_str(), p.as_slice()) {
        ("SIMPLE_PINHOLE", &[f, x, y]) => ([f, f], [x, y], Lens::default()),
        ("PINHOLE", &[fx, fy, x, y]) => ([fx, fy], [x, y], Lens::default()),
        ("SIMPLE_RADIAL", &[f, x, y, k]) => ([f, f], [x, y], lens([k, 0.0], [0.0; 2])),
        ("RADIAL", &[f, x, y, k1, k2]) => ([f, f], [x, y], lens([k1, k2], [0.0; 2])),
        ("OPENCV", &[fx, fy, x, y, k1, k2, p1, p2]) => ([fx, fy], [x, y], lens([k1, k2], [p1, p2])),
        ("SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV", _) => {
            let found = format!("{} parameters of {}", p.len(), camera.model);
            return Err(InputError::new(file, at, found, "as many as the camera model has"));
        }
        (other, _) => return Err(InputError::new(file, format!("{at} model"), other, SUPPORTED)),
    };
    if p.iter().any(|v| !v.is_finite()) || focal.iter().any(|f| *f <= 0.0) {
        return Err(InputError::new(
            file,
            at,
            format!("{p:?}"),
            "finite parameters and focal lengths above 0",
        ));
    }
    let [width, height] =
        camera.size.map(|n| u32::try_from(n).ok().filter(|n| (1..=1 << 16).contains(n)));
    let (Some(width), Some(height)) = (width, height) else {
        return Err(InputError::new(
            file,
            at,
            format!("size {:?}", camera.size),
            "a width and height from 1 to 65536",
        ));
    };
    let (eye, right, up, forward) = (DVec3::ZERO, DVec3::X, DVec3::Y, -DVec3::Z);
    let (focal, principal) = (DVec2::from(focal), DVec2::from(principal));
    Ok((Camera { width, height, focal, principal, eye, right, up, forward }, lens))
}

fn pending(
    file: &Path,
    folder: &Path,
    cameras: &BTreeMap<u32, (Camera, Lens)>,
    image: Registered,
) -> Result<Pending> {
    let (camera, lens) = cameras.get(&image.camera).ok_or_else(|| {
        InputError::new(
            file,
            &image.name,
            format!("camera {}", image.camera),
            "a camera that the model has",
        )
    })?;
    let error = |found: String, expected: &str| {
        InputError::new(file, format!("pose of {}", image.name), found, expected)
    };
    let [w, x, y, z] = image.quaternion;
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let length = quaternion.length();
    if !(length - 1.0).abs().le(&1e-3) || !image.translation.is_finite() {
        let found = format!("quaternion {:?}, translation {}", image.quaternion, image.translation);
        return Err(error(found, "a unit quaternion (w, x, y, z) and a finite translation"));
    }
    let rows = DMat3::from_quat(quaternion / length).transpose();
    let pose = camera_to_world(rows.x_axis, rows.y_axis, rows.z_axis, -(rows * image.translation));
    let camera =
        Camera::from_pose(camera.width, camera.height, camera.focal, camera.principal, pose)
            .ok_or_else(|| error(pose_fault(pose), "a rotation and a translation"))?;
    let path = folder.join(&image.name);
    let mask = mask_of(folder, &image.name);
    Ok(Pending {
        name: image.name,
        path,
        mask,
        camera,
        lens: *lens,
        size_from: format!("camera {}", image.camera),
    })
}

/// `masks/a.jpg.png` (COLMAP's own naming) or `masks/a.png` for `images/a.jpg`.
fn mask_of(folder: &Path, name: &str) -> Option<PathBuf> {
    let masks = folder.parent()?.join("masks");
    let stem = Path::new(name).with_extension("png");
    [masks.join(format!("{name}.png")), masks.join(stem), masks.join(name)]
        .into_iter()
        .find(|p| p.is_file())
}
