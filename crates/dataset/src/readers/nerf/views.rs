//! The views of frames.

use std::path::{Path, PathBuf};

use glam::{DMat4, DVec2};
use serde_json::Value;

use super::frame::Frame;
use crate::readers::MaskKind;
use crate::readers::images::reduced_copies;
use crate::readers::lookup::{image_named, mask_place};
use crate::readers::mask::MaskFile;
use crate::readers::pixels::whole_pixels;
use crate::readers::projection::{flipped, is_none, placed};
use crate::readers::recognised::Views;
use crate::readers::result::Result;
use crate::readers::unread::UnreadView;
use files::InputError;
use files::json::{has_gap, numbers, shown};
use film::image_size;
use render::Camera;

/// The least angle across an image, in radians. The narrowest telescopes see more.
const LEAST_ANGLE: f64 = 1e-6;

/// The frames of a file with their places in it.
pub(super) fn frames<'a>(file: &Path, root: &'a Value) -> Result<Vec<(usize, &'a Value)>> {
    let frames = root["frames"].as_array().filter(|f| !f.is_empty());
    let frames = frames.ok_or_else(|| {
        InputError::new(file, "frames", shown(&root["frames"]), "an array with frames")
    })?;
    Ok(frames.iter().enumerate().collect())
}

pub(super) fn read_frames(
    folder: &Path,
    file: &Path,
    frames: Vec<(usize, &Value)>,
    root: &Value,
) -> Result<Views> {
    let mut views = Views::default();
    for (i, frame) in frames {
        Frame { file, root, frame, pointer: format!("frames/{i}") }.read(folder, &mut views)?;
    }
    Ok(views)
}

impl Frame<'_> {
    fn read(&self, folder: &Path, views: &mut Views) -> Result<()> {
        let name = self.frame["file_path"]
            .as_str()
            .filter(|_| !has_gap(&self.frame["file_path"]))
            .ok_or_else(|| self.error("file_path", "a file's name"))?;
        let (path, is_reduced) = image_path(folder, name);
        views.add(path, |path| {
            let lens = self.lens()?;
            if is_reduced {
                self.check_full_size(&path)?;
            }
            let Some((camera, scale)) = self.camera(&path)? else { return Ok(None) };
            let mask = self.mask(folder)?;
            let name = name.trim_start_matches("./").to_owned();
            let view = UnreadView::of_image(name, path, camera, lens);
            let file = self.file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let is_stated = self.number("w")?.is_some() || self.number("h")?.is_some();
            let view = UnreadView { mask, size_source: is_stated.then_some(file), ..view };
            let view = view.with_pose_scale(scale);
            Ok(Some(if is_reduced { view.of_reduced_image()? } else { view }))
        })
    }

    /// Refuses a reduced image of a file without the full size, to which the intrinsics belong.
    fn check_full_size(&self, image: &Path) -> Result<()> {
        for key in ["w", "h"] {
            if self.number(key)?.is_none() {
                let image = image.display();
                let expected = format!("the size of the full image in pixels, for {image} is less");
                return Err(InputError::new(self.file, key, "nothing", expected));
            }
        }
        Ok(())
    }

    /// The pinhole part of the camera, and the scale of its pose; `None` without a usable pose.
    /// `image` gives the size if the file does not.
    fn camera(&self, image: &Path) -> Result<Option<(Camera, f64)>> {
        let (width, height) = self.size(image)?;
        let (focal, principal) = match self.intrinsic_matrix()? {
            Some(found) => found,
            None => {
                let center = DVec2::new(f64::from(width), f64::from(height)) / 2.0;
                let x = self.number("cx")?.unwrap_or(center.x);
                let y = self.number("cy")?.unwrap_or(center.y);
                (self.focal(width, height)?, DVec2::new(x, y))
            }
        };
        let is_opencv = self.root["from_na"].as_bool() == Some(true);
        let pose = if is_opencv { flipped(self.pose()?) } else { self.pose()? };
        placed([width, height], focal, principal, pose, |found| {
            let expected = "a camera-to-world matrix whose upper 3 x 3 is a rotation";
            InputError::new(self.file, self.place("transform_matrix"), found, expected)
        })
    }

    /// Focal lengths and principal point of NeuS2's `intrinsic_matrix`: K, with zeros around it or
    /// not.
    fn intrinsic_matrix(&self) -> Result<Option<(DVec2, DVec2)>> {
        let value = self.value("intrinsic_matrix");
        if value.is_null() {
            return Ok(None);
        }
        let entry = |r: usize, c: usize| value[r][c].as_f64().filter(|v| v.is_finite());
        let pair = |a: Option<f64>, b: Option<f64>| Some(DVec2::new(a?, b?));
        let focal = pair(entry(0, 0), entry(1, 1)).filter(|focal| focal.min_element() > 0.0);
        focal.zip(pair(entry(0, 2), entry(1, 2))).map(Some).ok_or_else(|| {
            let place = self.place("intrinsic_matrix");
            InputError::new(self.file, place, shown(value), "K with focal lengths above 0")
        })
    }

    /// Width and height in pixels, from the file or else from the image.
    fn size(&self, image: &Path) -> Result<(u32, u32)> {
        let keys = [self.number("w")?, self.number("h")?];
        let (width, height) = if keys.contains(&None) { image_size(image)? } else { (0, 0) };
        let pick = |key: &str, value: Option<f64>, of_image: u32| match value {
            None => Ok(of_image),
            Some(n) => whole_pixels(n).ok_or_else(|| {
                let expected = "a whole number of pixels from 1 to 65535";
                InputError::new(self.file, key, n, expected)
            }),
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

    /// `transform_matrix`: three or four rows, the fourth (0, 0, 0, 1). All of it is NaN if it is
    /// null, or has a number that is not finite.
    fn pose(&self) -> Result<DMat4> {
        let value = &self.frame["transform_matrix"];
        if self.frame.get("transform_matrix").is_some_and(has_gap) {
            return Ok(DMat4::NAN);
        }
        let error =
            || self.error("transform_matrix", "a 4 x 4 matrix of finite numbers, row-major");
        let rows = value.as_array().filter(|r| r.len() == 4 || r.len() == 3).ok_or_else(error)?;
        let rows: Option<Vec<[f64; 4]>> = rows.iter().map(numbers).collect();
        let r = rows.ok_or_else(error)?;
        let pose = DMat4::from_cols_array_2d(&[r[0], r[1], r[2], [0.0, 0.0, 0.0, 1.0]]).transpose();
        // Programs write zeros for poses that they do not have.
        if is_none(pose) {
            return Ok(DMat4::NAN);
        }
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
        Ok(pose)
    }

    /// The mask file of `mask_path`: nerfstudio's key, which tells which pixels to use.
    fn mask(&self, folder: &Path) -> Result<Option<MaskFile>> {
        match &self.frame["mask_path"] {
            Value::Null => Ok(None),
            Value::String(mask) if mask.trim().is_empty() => Ok(None),
            Value::String(mask) => {
                let path = mask_place(folder, mask);
                Ok(Some(MaskFile { kind: MaskKind::Used, path, is_dynamic: false }))
            }
            _ => Err(self.error("mask_path", "a file's name")),
        }
    }
}

/// The file of an image, whose name may lack the extension, and whether it is a reduced copy: that
/// in `images_2`, `images_4` or `images_8`, if there is no folder `images`.
fn image_path(folder: &Path, name: &str) -> (PathBuf, bool) {
    let full = folder.join(name);
    if let Some(path) = image_named(folder, name) {
        return (path, false);
    }
    let (Some(parent), Some(file)) = (full.parent(), full.file_name()) else {
        return (full, false);
    };
    let file = file.to_string_lossy();
    let mut copies = reduced_copies(parent).filter(|_| !parent.exists());
    let reduced = copies.find_map(|copy| image_named(&copy, &file));
    reduced.map_or((full.clone(), false), |path| (path, true))
}
