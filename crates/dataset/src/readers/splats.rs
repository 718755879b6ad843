//! The cameras beside a result of 3D Gaussian splatting: `cameras.json` (Kerbl et al., "3D Gaussian
//! Splatting for Real-Time Radiance Field Rendering", SIGGRAPH 2023).
//!
//! `rotation` is that of camera-to-world, by rows, with OpenCV axes (x right, y down, z forward), and
//! `position` is the camera's. The principal point is the middle of the image. The points are those
//! of `input.ply`, which training started from.

use std::path::Path;

use glam::{DMat3, DVec2, DVec3};
use serde_json::Value;

use crate::readers::lens::Lens;
use crate::readers::lookup::image_place;
use crate::readers::pixels::whole_pixels;
use crate::readers::ply;
use crate::readers::projection::{camera_to_world, placed};
use crate::readers::recognised::{Recognised, Views};
use crate::readers::result::Result;
use crate::readers::unread::UnreadView;
use files::InputError;
use files::json::{has_gap, numbers, shown};

/// Whether a JSON file has this form.
pub(crate) fn is_form(root: &Value) -> bool {
    let mut cameras = root.as_array().into_iter().flatten();
    cameras.any(|camera| camera["img_name"].is_string() && camera["rotation"].is_array())
}

/// Reads the cameras.
pub(crate) fn read(folder: &Path, file: &Path, root: &Value) -> Result<Recognised> {
    let mut views = Views::default();
    for (i, camera) in root.as_array().into_iter().flatten().enumerate() {
        let camera = Entry { file, camera, i };
        let name = camera.camera["img_name"].as_str();
        let name = name.ok_or_else(|| camera.error("img_name", "a file's name"))?;
        views.add(image_place(folder, name), |path| camera.view(name, path))?;
    }
    let points = folder.join("input.ply");
    let points = if points.is_file() { ply::points(&points)? } else { Vec::new() };
    let format = "3D Gaussian splatting cameras.json: camera-to-world, OpenCV axes";
    Ok(Recognised { points, ..Recognised::new(format, views) })
}

/// One camera of the file.
struct Entry<'a> {
    file: &'a Path,
    camera: &'a Value,
    i: usize,
}

impl Entry<'_> {
    fn error(&self, key: &str, expected: &str) -> InputError {
        InputError::new(self.file, format!("{}/{key}", self.i), shown(&self.camera[key]), expected)
    }

    fn positive(&self, key: &str) -> Result<f64> {
        let number = self.camera[key].as_f64().filter(|v| v.is_finite() && *v > 0.0);
        number.ok_or_else(|| self.error(key, "a number above 0"))
    }

    fn view(&self, name: &str, path: std::path::PathBuf) -> Result<Option<UnreadView>> {
        let side = |key| {
            let side = whole_pixels(self.positive(key)?);
            side.ok_or_else(|| self.error(key, "a whole number of pixels from 1 to 65535"))
        };
        let size = [side("width")?, side("height")?];
        let focal = DVec2::new(self.positive("fx")?, self.positive("fy")?);
        let Some((axes, eye)) = self.pose()? else { return Ok(None) };
        let pose = camera_to_world(axes.x_axis, axes.y_axis, axes.z_axis, eye);
        let principal = DVec2::new(f64::from(size[0]), f64::from(size[1])) / 2.0;
        let wrong =
            |found| InputError::new(self.file, format!("{}/rotation", self.i), found, "a rotation");
        let placed = placed(size, focal, principal, pose, wrong)?;
        let Some((camera, scale)) = placed else { return Ok(None) };
        let view = UnreadView::of_image(name.to_owned(), path, camera, Lens::default());
        let size_source = Some("cameras.json".to_owned());
        Ok(Some(UnreadView { size_source, ..view }.with_pose_scale(scale)))
    }

    /// The axes in the columns of a matrix, and the position; `None` if a number is not finite.
    fn pose(&self) -> Result<Option<(DMat3, DVec3)>> {
        if ["rotation", "position"].iter().any(|key| self.camera.get(key).is_some_and(has_gap)) {
            return Ok(None);
        }
        let row = |i: usize| {
            let row = numbers::<3>(&self.camera["rotation"][i]).map(DVec3::from);
            row.ok_or_else(|| self.error("rotation", "3 x 3 finite numbers"))
        };
        let eye = numbers::<3>(&self.camera["position"]).map(DVec3::from);
        let eye = eye.ok_or_else(|| self.error("position", "3 finite numbers"))?;
        Ok(Some((DMat3::from_cols(row(0)?, row(1)?, row(2)?).transpose(), eye)))
    }
}
