//! NeuS/IDR data sets: `cameras_sphere.npz` with `image/` and `mask/`.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use field::Sphere;
use glam::{DMat3, DMat4, DVec2, DVec3};
use npyz::NpyFile;
use zip::ZipArchive;
use zip::result::ZipError;

use super::lens::Lens;
use super::{Found, Pending};
use io::InputError;
use io::image_size;
use render::Camera;

type Result<T> = std::result::Result<T, InputError>;

/// Reads the cameras and pairs them with the images in the order of their names.
pub(super) fn read(folder: &Path) -> Result<Found> {
    let file = folder.join("cameras_sphere.npz");
    let mut archive = File::open(&file)
        .map_err(ZipError::from)
        .and_then(|f| ZipArchive::new(BufReader::new(f)))
        .map_err(|e| InputError::new(&file, "archive", e, "a .npz archive"))?;
    let images = images(&folder.join("image"))?;
    let cameras =
        archive.file_names().flatten().filter(|name| is_numbered(name, "world_mat_")).count();
    if cameras != images.len() {
        let expected = format!("{}, one for each image in image/", images.len());
        return Err(InputError::new(&file, "world_mat_*", format!("{cameras} arrays"), expected));
    }
    let masks = images_of(&folder.join("mask")).unwrap_or_default();
    let mut train = Vec::new();
    let mut bounds = None;
    for (i, path) in images.iter().enumerate() {
        let world = matrix(&file, &mut archive, &format!("world_mat_{i}"))?;
        let scale = matrix(&file, &mut archive, &format!("scale_mat_{i}"))?;
        bounds.get_or_insert(sphere(&file, scale, i)?);
        let (width, height) = image_size(path)?;
        let (camera, lens) = decompose(world, width, height).ok_or_else(|| {
            let expected = "K [R t] with a regular K and a rotation R";
            InputError::new(&file, format!("world_mat_{i}"), "a singular matrix", expected)
        })?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mask = mask_of(path, i, images.len(), &masks);
        let size_from = "the image".to_owned();
        train.push(Pending { name, path: path.clone(), mask, camera, lens, size_from });
    }
    let format =
        "NeuS/IDR cameras_sphere.npz: P = world_mat, OpenCV axes, integer pixel centres".to_owned();
    Ok(Found { format, train, test: None, bounds, points: Vec::new() })
}

fn is_numbered(name: &str, prefix: &str) -> bool {
    let number = name.strip_prefix(prefix).and_then(|rest| rest.strip_suffix(".npy"));
    number.is_some_and(|rest| !rest.is_empty() && rest.bytes().all(|b| b.is_ascii_digit()))
}

/// The mask of the same name, or else, where there are as many masks as images, of the same place
/// in the order of names.
fn mask_of(image: &Path, i: usize, images: usize, masks: &[PathBuf]) -> Option<PathBuf> {
    let same_name = masks.iter().find(|m| m.file_stem() == image.file_stem());
    same_name.or_else(|| masks.get(i).filter(|_| masks.len() == images)).cloned()
}

fn images(folder: &Path) -> Result<Vec<PathBuf>> {
    let images = images_of(folder)
        .map_err(|e| InputError::new(folder, "images", e, "a folder with images"))?;
    if images.is_empty() {
        return Err(InputError::new(folder, "images", "none", "PNG or JPEG files"));
    }
    Ok(images)
}

fn images_of(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)?.flatten().map(|e| e.path()).collect();
    paths.retain(|p| {
        p.extension().is_some_and(|e| {
            ["png", "jpg", "jpeg"].contains(&e.to_string_lossy().to_lowercase().as_str())
        })
    });
    paths.sort();
    Ok(paths)
}

fn matrix(file: &Path, archive: &mut ZipArchive<BufReader<File>>, name: &str) -> Result<DMat4> {
    let error =
        |found: String| InputError::new(file, name, found, "a 4 x 4 matrix of finite floats");
    let entry = match archive.by_name(&format!("{name}.npy")) {
        Err(ZipError::FileNotFound) => return Err(error("nothing".to_owned())),
        entry => entry.map_err(|e| error(e.to_string()))?,
    };
    let npy = NpyFile::new(entry).map_err(|e| error(e.to_string()))?;
    let shape = npy.shape().to_vec();
    let by_columns = npy.order() == npyz::Order::Fortran;
    let wide = npy.dtype().descr().contains("f8");
    let numbers: std::io::Result<Vec<f64>> = if wide {
        npy.into_vec()
    } else {
        npy.into_vec::<f32>().map(|v| v.into_iter().map(f64::from).collect())
    };
    let numbers = numbers.map_err(|e| error(e.to_string()))?;
    match <[f64; 16]>::try_from(numbers) {
        Ok(m) if shape == [4, 4] && m.iter().all(|v| v.is_finite()) => {
            let m = DMat4::from_cols_array(&m);
            Ok(if by_columns { m } else { m.transpose() })
        }
        Ok(_) => Err(error(format!("shape {shape:?} or a number that is not finite"))),
        Err(_) => Err(error(format!("shape {shape:?}"))),
    }
}

/// The unit sphere of the scaled frame, in world units.
fn sphere(file: &Path, scale: DMat4, i: usize) -> Result<Sphere<f64>> {
    let axes = DMat3::from_mat4(scale);
    let radius = axes.x_axis.length();
    // A sphere stays one under uniform scale and rotation only.
    let uneven = axes.transpose() * axes - DMat3::from_diagonal(DVec3::splat(radius * radius));
    let largest = uneven.to_cols_array().into_iter().fold(0.0, |a: f64, v| a.max(v.abs()));
    if radius > 0.0 && largest <= 1e-4 * radius * radius {
        return Ok(Sphere { center: scale.w_axis.truncate(), radius });
    }
    let found = format!("columns {}, {}, {}", axes.x_axis, axes.y_axis, axes.z_axis);
    Err(InputError::new(
        file,
        format!("scale_mat_{i}"),
        found,
        "a uniform scale above 0, and a translation",
    ))
}

/// The camera of P = K [R t] (rows of a 4 × 4) and the lens that stands for K's skew, or `None` if
/// K is singular.
///
/// With M = K R, K is upper triangular and R a rotation: the rows of M, from the last to the first,
/// orthonormalised are those of R (an RQ decomposition).
pub(super) fn decompose(p: DMat4, width: u32, height: u32) -> Option<(Camera, Lens)> {
    let m = DMat3::from_mat4(p);
    let rows = m.transpose();
    let (a, b, c) = (rows.x_axis, rows.y_axis, rows.z_axis);
    let z = c.try_normalize()?;
    let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    let scale = c.length();
    let y = b.reject_from_normalized(z).try_normalize()?;
    let x = (a.reject_from_normalized(z)).reject_from_normalized(y).try_normalize()?;
    let focal = DVec2::new(a.dot(x), b.dot(y)) / scale;
    let lens = Lens { skew: a.dot(y) / scale, ..Lens::default() };
    // Integer pixel centres: our pixel 0 covers [0, 1).
    let principal = DVec2::new(a.dot(z), b.dot(z)) / scale + 0.5;
    let eye = -(m.inverse() * p.w_axis.truncate());
    // What is left of a row after rounding is no focal length: K then has no inverse worth the
    // name.
    let regular =
        focal.is_finite() && focal.min_element() > 1e-9 * (focal + principal.abs()).max_element();
    // The axes are x right, y down, z forward, up to the sign of P.
    let pose = camera_to_world(x * sign, y * sign, z * sign, eye);
    let camera =
        if regular { Camera::from_pose(width, height, focal, principal, pose) } else { None };
    camera.map(|camera| (camera, lens))
}

/// The pose of a camera with axes x right, y down, z forward in world space.
pub(super) fn camera_to_world(x: DVec3, y: DVec3, z: DVec3, eye: DVec3) -> DMat4 {
    DMat4::from_cols(x.extend(0.0), (-y).extend(0.0), (-z).extend(0.0), eye.extend(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn a_projection_comes_apart_into_its_camera() {
        let (focal, principal) = (DVec2::new(300.0, 310.0), DVec2::new(101.5, 77.5));
        let camera = Camera::look_at(
            200,
            150,
            focal,
            principal,
            DVec3::new(1.0, 2.0, 3.0),
            DVec3::ZERO,
            DVec3::Y,
        )
        .unwrap();
        let k = DMat3::from_cols(
            DVec3::X * 300.0,
            DVec3::new(1.5, 310.0, 0.0),
            DVec3::new(101.0, 77.0, 1.0),
        );
        let r = DMat3::from_cols(camera.right, -camera.up, camera.forward).transpose();
        for sign in [2.0, -0.5] {
            let (m, t) = (k * r * sign, k * (r * -camera.eye) * sign);
            let p = DMat4::from_cols(
                m.x_axis.extend(0.0),
                m.y_axis.extend(0.0),
                m.z_axis.extend(0.0),
                t.extend(1.0),
            );
            let (found, lens) = decompose(p, 200, 150).unwrap();
            assert_relative_eq!(lens.skew, 1.5, epsilon = 1e-9);
            assert_relative_eq!(found.focal, focal, epsilon = 1e-9);
            assert_relative_eq!(found.principal, principal, epsilon = 1e-9);
            assert_relative_eq!(found.eye, camera.eye, epsilon = 1e-9);
            assert_relative_eq!(found.forward, camera.forward, epsilon = 1e-9);
            assert_relative_eq!(found.up, camera.up, epsilon = 1e-9);
        }
        let rank_two = DMat4::from_cols_array(&[
            1.0, 2.0, 3.0, 0.0, 4.0, 5.0, 9.0, 0.0, 7.0, 8.0, 15.0, 0.0, 1.0, 1.0, 1.0, 1.0,
        ]);
        for singular in [DMat4::ZERO, rank_two, DMat4::NAN] {
            assert!(decompose(singular, 200, 150).is_none(), "{singular}");
        }
    }
}
