//! NeRF/Blender data sets: `transforms*.json` (Mildenhall et al., "NeRF: Representing Scenes as
//! Neural Radiance Fields for View Synthesis", ECCV 2020), with the intrinsics and the distortion
//! of instant-ngp and nerfstudio.
//!
//! A pose is camera-to-world, x right, y up, looking along −z: the convention of [`Camera`]. A key
//! of a frame overrides the same key of the file.

use std::path::{Path, PathBuf};

use glam::{DMat4, DVec2};
use serde_json::Value;

use super::{Recognised, Result};
use crate::MaskKind;
use crate::lens::Lens;
use crate::projection::pose_fault;
use crate::unread::UnreadView;
use io::json::{numbers, shown};
use io::{InputError, image_size, refuse_unconverted};
use render::Camera;

/// The least angle across an image, in radians. The narrowest telescopes see more.
const LEAST_ANGLE: f64 = 1e-6;

/// Camera models of a perspective lens with at most k1, k2, p1 and p2.
const CAMERA_MODELS: [&str; 5] = ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"];

/// Reads the frames of `file`. If it is `transforms_train.json`, the frames of
/// `transforms_test.json`, or else of `transforms_val.json`, are the held-out views.
pub(super) fn read(folder: &Path, file: &Path) -> Result<Recognised> {
    let train = read_frames(folder, file)?;
    let has_split = file.file_name().is_some_and(|n| n == "transforms_train.json");
    let sibling = ["transforms_test.json", "transforms_val.json"]
        .map(|n| folder.join(n))
        .into_iter()
        .find(|p| p.exists());
    let test = match sibling.filter(|_| has_split) {
        Some(path) => Some(read_frames(folder, &path)?),
        None => None,
    };
    let format =
        "NeRF/Blender transforms: camera-to-world, x right, y up, looking along -z".to_owned();
    Ok(Recognised { format, train, test, bounds: None, points: Vec::new() })
}

fn read_frames(folder: &Path, file: &Path) -> Result<Vec<UnreadView>> {
    let root = io::json::read(file)?;
    let frames = root["frames"].as_array().filter(|f| !f.is_empty());
    let frames = frames.ok_or_else(|| {
        InputError::new(file, "frames", shown(&root["frames"]), "an array with frames")
    })?;
    let frame = |(i, frame)| Frame { file, root: &root, frame, pointer: format!("frames/{i}") };
    frames.iter().enumerate().map(frame).map(|frame| frame.read(folder)).collect()
}

/// One frame, and the file that has the defaults of all frames.
struct Frame<'a> {
    file: &'a Path,
    root: &'a Value,
    frame: &'a Value,
    /// `frames/N`, for messages.
    pointer: String,
}

impl Frame<'_> {
    fn read(&self, folder: &Path) -> Result<UnreadView> {
        let name = self.frame["file_path"]
            .as_str()
            .ok_or_else(|| self.error("file_path", "a file's name"))?;
        let path = image_path(folder, name);
        let path = path.map_or_else(|| self.no_image(&folder.join(name)), Ok)?;
        let lens = self.lens()?;
        let camera = self.camera(&path)?;
        let mask = self.mask(folder, name)?;
        let size_source = self.file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let name = name.trim_start_matches("./").to_owned();
        Ok(UnreadView { name, path, mask, camera, lens, size_source })
    }

    /// Refuses the frame, whose image `path` is missing.
    fn no_image(&self, path: &Path) -> Result<PathBuf> {
        refuse_unconverted(path)?;
        let expected = format!("the image of {} in {}", self.pointer, self.file.display());
        Err(InputError::new(path, "image", "no such file", expected))
    }

    /// The value of the frame, or else of the file; null if neither has the key.
    fn value(&self, key: &str) -> &Value {
        if self.frame[key].is_null() { &self.root[key] } else { &self.frame[key] }
    }

    /// A finite number of the frame, or else of the file.
    fn number(&self, key: &str) -> Result<Option<f64>> {
        let value = self.value(key);
        if value.is_null() {
            return Ok(None);
        }
        let number = value.as_f64().filter(|v| v.is_finite());
        number.map(Some).ok_or_else(|| {
            let in_frame = !self.frame[key].is_null();
            let place = if in_frame { self.place(key) } else { key.to_owned() };
            InputError::new(self.file, place, shown(value), "a finite number")
        })
    }

    fn place(&self, key: &str) -> String {
        format!("{}/{key}", self.pointer)
    }

    /// The error of a key of the frame.
    fn error(&self, key: &str, expected: &str) -> InputError {
        InputError::new(self.file, self.place(key), shown(&self.frame[key]), expected)
    }

    /// The pinhole part of the camera; `image` gives the size if the file does not.
    fn camera(&self, image: &Path) -> Result<Camera> {
        let (width, height) = self.size(image)?;
        let focal = self.focal(width, height)?;
        let center = DVec2::new(f64::from(width), f64::from(height)) / 2.0;
        let principal = DVec2::new(
            self.number("cx")?.unwrap_or(center.x),
            self.number("cy")?.unwrap_or(center.y),
        );
        let pose = self.pose()?;
        Camera::from_pose(width, height, focal, principal, pose).ok_or_else(|| {
            let expected = "a camera-to-world matrix whose upper 3 x 3 is a rotation";
            InputError::new(self.file, self.place("transform_matrix"), pose_fault(pose), expected)
        })
    }

    /// Width and height in pixels, from the file or else from the image.
    fn size(&self, image: &Path) -> Result<(u32, u32)> {
        let keys = [self.number("w")?, self.number("h")?];
        let (width, height) = if keys.contains(&None) { image_size(image)? } else { (0, 0) };
        let pick = |key: &str, value: Option<f64>, of_image: u32| match value {
            None => Ok(of_image),
            Some(n) if n >= 1.0 && n <= f64::from(u16::MAX) && n.fract() == 0.0 => Ok(n as u32),
            Some(n) => {
                let expected = "a whole number of pixels from 1 to 65535";
                Err(InputError::new(self.file, key, n, expected))
            }
        };
        Ok((pick("w", keys[0], width)?, pick("h", keys[1], height)?))
    }

    /// Focal lengths in pixels: `fl_x` and `fl_y`, or else from the fields of view
    /// `camera_angle_x` and `camera_angle_y` in radians. y is as x if it has no key.
    fn focal(&self, width: u32, height: u32) -> Result<DVec2> {
        let x = self.focal_along("fl_x", "camera_angle_x", width)?;
        let y = self.focal_along("fl_y", "camera_angle_y", height)?.or(x);
        match (x, y) {
            (Some(x), Some(y)) if x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite() => {
                Ok(DVec2::new(x, y))
            }
            (Some(x), y) => {
                let found = format!("focal lengths {x}, {}", y.unwrap_or(x));
                let expected = "focal lengths above 0";
                Err(InputError::new(self.file, "fl_x", found, expected))
            }
            (None, _) => {
                let expected = "camera_angle_x, or fl_x in pixels";
                Err(InputError::new(self.file, "camera_angle_x", "nothing", expected))
            }
        }
    }

    /// The focal length `key` in pixels, or else that of the field of view `angle` in radians.
    fn focal_along(&self, key: &str, angle: &str, size: u32) -> Result<Option<f64>> {
        if let Some(focal) = self.number(key)? {
            return Ok(Some(focal));
        }
        match self.number(angle)? {
            Some(found) if !(LEAST_ANGLE..std::f64::consts::PI).contains(&found) => {
                let expected = "an angle from 1e-6 to pi, in radians";
                Err(InputError::new(self.file, angle, found, expected))
            }
            found => Ok(found.map(|a| 0.5 * f64::from(size) / (0.5 * a).tan())),
        }
    }

    /// Distortion: OPENCV's k1, k2, p1 and p2, of the frame or of the file. Other models are
    /// refused.
    fn lens(&self) -> Result<Lens> {
        let model = self.value("camera_model");
        let is_known = |m: &str| CAMERA_MODELS.contains(&m.to_uppercase().as_str());
        if !model.is_null() && !model.as_str().is_some_and(is_known) {
            let expected = CAMERA_MODELS.join(", ");
            return Err(InputError::new(self.file, "camera_model", shown(model), expected));
        }
        if self.value("is_fisheye").as_bool() == Some(true) {
            let expected = "a perspective lens (undistort the images first)";
            return Err(InputError::new(self.file, "is_fisheye", "true", expected));
        }
        let get = |key: &str| self.number(key).map(|v| v.unwrap_or(0.0));
        for key in ["k3", "k4"] {
            let value = get(key)?;
            if value != 0.0 {
                let expected = "0: only k1, k2, p1 and p2 are modelled";
                return Err(InputError::new(self.file, key, value, expected));
            }
        }
        let (radial, tangential) = ([get("k1")?, get("k2")?], [get("p1")?, get("p2")?]);
        Ok(Lens { radial, tangential, skew: 0.0 })
    }

    /// `transform_matrix`: three or four rows, the fourth (0, 0, 0, 1).
    fn pose(&self) -> Result<DMat4> {
        let value = &self.frame["transform_matrix"];
        let error =
            || self.error("transform_matrix", "a 4 x 4 matrix of finite numbers, row-major");
        let rows = value.as_array().filter(|r| r.len() == 4 || r.len() == 3).ok_or_else(error)?;
        let rows: Option<Vec<[f64; 4]>> = rows.iter().map(numbers).collect();
        let r = rows.ok_or_else(error)?;
        if r.get(3).is_some_and(|last| *last != [0.0, 0.0, 0.0, 1.0]) {
            let found = format!("last row {:?}", r[3]);
            let expected = "last row [0, 0, 0, 1] (row-major)";
            return Err(InputError::new(
                self.file,
                self.place("transform_matrix"),
                found,
                expected,
            ));
        }
        Ok(DMat4::from_cols_array_2d(&[r[0], r[1], r[2], [0.0, 0.0, 0.0, 1.0]]).transpose())
    }

    /// The mask file. `mask_path` is nerfstudio's key, and tells which pixels to use. A file of the
    /// same name in `masks/` is a mask of the object.
    fn mask(&self, folder: &Path, name: &str) -> Result<Option<(MaskKind, PathBuf)>> {
        match &self.frame["mask_path"] {
            Value::Null => Ok(sibling_mask(folder, name).map(|mask| (MaskKind::Object, mask))),
            Value::String(mask) => {
                let file = image_path(folder, mask).unwrap_or_else(|| folder.join(mask));
                Ok(Some((MaskKind::Used, file)))
            }
            _ => Err(self.error("mask_path", "a file's name")),
        }
    }
}

/// The file of an image whose name may lack the extension.
fn image_path(folder: &Path, name: &str) -> Option<PathBuf> {
    let as_named = folder.join(name);
    let with_extension = ["png", "jpg", "jpeg", "exr"].map(|e| folder.join(format!("{name}.{e}")));
    std::iter::once(as_named).chain(with_extension).find(|p| p.is_file())
}

/// `masks/train/r_000.png` for `./train/r_000`, or else `masks/r_000.png`.
fn sibling_mask(folder: &Path, name: &str) -> Option<PathBuf> {
    let name = name.trim_start_matches("./");
    let file = name.rsplit_once('/').map_or(name, |(_, file)| file);
    let names = [name, without_extension(name), file, without_extension(file)];
    names.into_iter().find_map(|n| image_path(&folder.join("masks"), n))
}

/// The part of a name before its last point, or all of it.
fn without_extension(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}
