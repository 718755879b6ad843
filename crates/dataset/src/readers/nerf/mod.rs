//! NeRF/Blender data sets: `transforms*.json` (Mildenhall et al., "NeRF: Representing Scenes as
//! Neural Radiance Fields for View Synthesis", ECCV 2020), with the intrinsics and the distortion
//! of instant-ngp and nerfstudio, and nerfstudio's lists of splits and point cloud.
//!
//! A pose is camera-to-world, x right, y up, looking along −z: the convention of [`render::Camera`]. A key
//! of a frame overrides the same key of the file.
//!
//! nerfstudio's `applied_transform` and `applied_scale` tell how its world was made from that of
//! another program. The poses and the point cloud have them applied already, so they are checked
//! and not used: all results are in the world of the file's own poses.
//!
//! NeuS2's files are of this form: `intrinsic_matrix` is K of a frame, and `from_na` says that the
//! camera's axes are those of OpenCV.

mod frame;
mod lens;
mod split;
mod views;

use std::path::Path;

use field::Sphere;
use serde_json::Value;

use crate::readers::ply;
use crate::readers::recognised::Recognised;
use crate::readers::result::Result;
use files::InputError;
use files::json::{numbers, shown};
use views::{frames, read_frames};

/// Reads the frames of `file`. If it is `transforms_train.json`, the frames of
/// `transforms_test.json`, or else of `transforms_val.json`, are the held-out views. Else the file
/// may have lists of the frames of each split.
pub(crate) fn read(folder: &Path, file: &Path, root: &Value) -> Result<Recognised> {
    let has_split = file.file_name().is_some_and(|n| n == "transforms_train.json");
    let sibling = ["transforms_test.json", "transforms_val.json"]
        .map(|n| folder.join(n))
        .into_iter()
        .find(|p| p.exists());
    let format = "NeRF/Blender transforms: camera-to-world, x right, y up, looking along -z";
    let mut recognised = match (split::lists(file, root)?, sibling.filter(|_| has_split)) {
        (Some(lists), _) => lists.read(folder, file, root, format)?,
        (None, Some(path)) => {
            let train = read_frames(folder, file, frames(file, root)?, root)?;
            let other = files::json::read(&path)?;
            let test = read_frames(folder, &path, frames(&path, &other)?, &other)?;
            Recognised::with_split(format, train, test)
        }
        (None, None) => {
            let views = read_frames(folder, file, frames(file, root)?, root)?;
            Recognised::new(format, views)
        }
    };
    check_applied(file, root)?;
    recognised.bounds = bounds(root);
    match &root["ply_file_path"] {
        Value::Null => {}
        Value::String(name) if folder.join(name).exists() => {
            recognised.points = ply::points(&folder.join(name))?;
        }
        Value::String(name) => {
            let note = format!("the point cloud {name} (ply_file_path) is missing");
            recognised.notes.push(files::printable(&note));
        }
        other => {
            return Err(InputError::new(file, "ply_file_path", shown(other), "a file's name"));
        }
    }
    Ok(recognised)
}

/// Neuralangelo's sphere around the object: `sphere_center` and `sphere_radius`, in the world of the
/// poses.
fn bounds(root: &Value) -> Option<Sphere<f64>> {
    let center = numbers::<3>(&root["sphere_center"])?.into();
    let radius = root["sphere_radius"].as_f64().filter(|r| r.is_finite() && *r > 0.0)?;
    Some(Sphere { center, radius })
}

/// Checks the numbers of `applied_transform` and `applied_scale`, which are not used.
fn check_applied(file: &Path, root: &Value) -> Result<()> {
    let (transform, scale) = (&root["applied_transform"], &root["applied_scale"]);
    let rows = transform.as_array().filter(|rows| rows.len() == 3 || rows.len() == 4);
    let is_matrix = rows.is_some_and(|rows| rows.iter().all(|r| numbers::<4>(r).is_some()));
    if !transform.is_null() && !is_matrix {
        let expected = "a 3 x 4 or 4 x 4 matrix of finite numbers";
        return Err(InputError::new(file, "applied_transform", shown(transform), expected));
    }
    if !scale.is_null() && !scale.as_f64().is_some_and(|v| v.is_finite() && v > 0.0) {
        return Err(InputError::new(file, "applied_scale", shown(scale), "a number above 0"));
    }
    Ok(())
}
