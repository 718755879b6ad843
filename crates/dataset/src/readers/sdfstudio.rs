//! SDFStudio data sets: `meta_data.json` (Yu et al., "SDFStudio: A Unified Framework for Surface
//! Reconstruction", 2022).
//!
//! `camtoworld` of a frame is camera-to-world, OpenCV axes: x right, y down, z forward. `intrinsics`
//! is K, with zeros around it or not. `scene_box` has the box or the radius of the object.

use std::path::Path;

use field::Sphere;
use glam::{DMat4, DVec2, DVec3};
use serde_json::Value;

use crate::readers::MaskKind;
use crate::readers::lens::Lens;
use crate::readers::lookup::{image_place, mask_place};
use crate::readers::mask::MaskFile;
use crate::readers::pixels::whole_pixels;
use crate::readers::projection::{flipped, placed};
use crate::readers::recognised::{Recognised, Views};
use crate::readers::result::Result;
use crate::readers::unread::UnreadView;
use files::InputError;
use files::json::{has_gap, numbers, shown};
use film::image_size;

/// Whether a JSON file has this form.
pub(crate) fn is_form(root: &Value) -> bool {
    let frames = root["frames"].as_array().into_iter().flatten();
    frames.into_iter().any(|frame| frame["camtoworld"].is_array())
}

/// Reads the frames.
pub(crate) fn read(folder: &Path, file: &Path, root: &Value) -> Result<Recognised> {
    let frames = root["frames"].as_array().filter(|frames| !frames.is_empty());
    let frames = frames.ok_or_else(|| {
        InputError::new(file, "frames", shown(&root["frames"]), "an array with frames")
    })?;
    let mut views = Views::default();
    for (i, frame) in frames.iter().enumerate() {
        let frame = Frame { file, root, frame, i };
        let name = frame.name("rgb_path")?;
        let path = image_place(folder, name);
        views.add(path, |path| {
            let size = frame.size(&path)?;
            let (focal, principal) = frame.intrinsics()?;
            let wrong =
                |found: String| frame.error("camtoworld", &found, "a rotation and a translation");
            let placed = placed(size, focal, principal, frame.pose()?, wrong)?;
            let Some((camera, scale)) = placed else { return Ok(None) };
            let view = UnreadView::of_image(name.to_owned(), path, camera, Lens::default());
            let mask = frame.mask(folder);
            let stated = root["width"].is_number().then(|| "meta_data.json".to_owned());
            Ok(Some(UnreadView { mask, size_source: stated, ..view }.with_pose_scale(scale)))
        })?;
    }
    let bounds = bounds(root);
    let format = "SDFStudio meta_data.json: camera-to-world, OpenCV axes";
    Ok(Recognised { bounds, ..Recognised::new(format, views) })
}

/// The sphere of `scene_box`: around the middle of its box, with its radius, or else with half of
/// the longest side.
fn bounds(root: &Value) -> Option<Sphere<f64>> {
    let scene = &root["scene_box"];
    let corner = |i: usize| numbers::<3>(&scene["aabb"][i]).map(DVec3::from);
    let (low, high) = (corner(0), corner(1));
    let center = low.zip(high).map_or(DVec3::ZERO, |(low, high)| (low + high) / 2.0);
    let half = low.zip(high).map(|(low, high)| (high - low).max_element() / 2.0);
    let radius = scene["radius"].as_f64().or(half).filter(|r| r.is_finite() && *r > 0.0)?;
    Some(Sphere { center, radius })
}

/// One frame.
struct Frame<'a> {
    file: &'a Path,
    root: &'a Value,
    frame: &'a Value,
    i: usize,
}

impl<'a> Frame<'a> {
    fn error(&self, key: &str, found: &str, expected: &str) -> InputError {
        InputError::new(self.file, format!("frames/{}/{key}", self.i), found, expected)
    }

    fn name(&self, key: &str) -> Result<&'a str> {
        let name = self.frame[key].as_str();
        name.ok_or_else(|| self.error(key, &shown(&self.frame[key]), "a file's name"))
    }

    /// The rows of a matrix with `N` columns; all of it is NaN if a number is not finite.
    fn rows<const N: usize>(&self, key: &str, least: usize) -> Result<Vec<[f64; N]>> {
        let value = &self.frame[key];
        if has_gap(value) {
            return Ok(vec![[f64::NAN; N]; least]);
        }
        let rows: Option<Vec<[f64; N]>> =
            value.as_array().and_then(|rows| rows.iter().map(numbers).collect());
        rows.filter(|rows| rows.len() >= least).ok_or_else(|| {
            let expected = format!("a matrix of {least} x {N} finite numbers or more rows");
            self.error(key, &shown(value), &expected)
        })
    }

    fn pose(&self) -> Result<DMat4> {
        let rows = self.rows::<4>("camtoworld", 3)?;
        let last = [0.0, 0.0, 0.0, 1.0];
        let pose = DMat4::from_cols_array_2d(&[rows[0], rows[1], rows[2], last]).transpose();
        Ok(flipped(pose))
    }

    /// Focal lengths and principal point in pixels.
    fn intrinsics(&self) -> Result<(DVec2, DVec2)> {
        let is_square = self.frame["intrinsics"][0].as_array().is_some_and(|row| row.len() == 3);
        let k = if is_square {
            self.rows::<3>("intrinsics", 2)?
        } else {
            let rows = self.rows::<4>("intrinsics", 2)?;
            rows.iter().map(|row| [row[0], row[1], row[2]]).collect()
        };
        let (focal, principal) = (DVec2::new(k[0][0], k[1][1]), DVec2::new(k[0][2], k[1][2]));
        if focal.min_element() > 0.0 && focal.is_finite() && principal.is_finite() {
            return Ok((focal, principal));
        }
        let found = shown(&self.frame["intrinsics"]);
        Err(self.error("intrinsics", &found, "K with focal lengths above 0"))
    }

    /// Width and height in pixels, of the file or else of the image.
    fn size(&self, image: &Path) -> Result<[u32; 2]> {
        let stated = ["width", "height"].map(|key| self.root[key].as_f64());
        let [Some(width), Some(height)] = stated else { return image_size(image).map(Into::into) };
        match [width, height].map(whole_pixels) {
            [Some(width), Some(height)] => Ok([width, height]),
            _ => {
                let found = format!("{width}, {height}");
                let expected = "whole numbers of pixels from 1 to 65535";
                Err(InputError::new(self.file, "width, height", found, expected))
            }
        }
    }

    /// The mask of the object.
    fn mask(&self, folder: &Path) -> Option<MaskFile> {
        let name = self.frame["foreground_mask"].as_str().filter(|name| !name.is_empty())?;
        let path = mask_place(folder, name);
        Some(MaskFile { kind: MaskKind::Object, path, is_dynamic: false })
    }
}
