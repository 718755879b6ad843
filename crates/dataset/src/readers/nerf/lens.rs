//! The distortion of a frame.

use super::frame::Frame;
use crate::readers::lens::Lens;
use crate::readers::result::Result;
use files::InputError;
use files::json::shown;

/// Camera models of a perspective lens. `PERSPECTIVE` is the name that nerfstudio's converter of
/// Record3D writes.
const PERSPECTIVE: [&str; 7] = [
    "OPENCV",
    "FULL_OPENCV",
    "PINHOLE",
    "SIMPLE_PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "PERSPECTIVE",
];

/// Camera models of a fisheye lens.
const FISHEYE: [&str; 3] = ["OPENCV_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_RADIAL_FISHEYE"];

impl Frame<'_> {
    /// Distortion: k1 to k6, p1 and p2, of the frame or of the file.
    ///
    /// With `k5` or `k6`, or the model `FULL_OPENCV`, k4 to k6 are the radial divisor of OpenCV's
    /// rational model. Without, k4 is the coefficient of r⁸, as in nerfstudio.
    pub(super) fn lens(&self) -> Result<Lens> {
        let model = self.value("camera_model");
        let name = model.as_str().map(str::to_uppercase);
        let is_one_of = |names: &[&str]| name.as_deref().is_some_and(|name| names.contains(&name));
        if !model.is_null() && !is_one_of(&PERSPECTIVE) && !is_one_of(&FISHEYE) {
            let expected = [&PERSPECTIVE[..], &FISHEYE].concat().join(", ");
            return Err(InputError::new(self.file, "camera_model", shown(model), expected));
        }
        let is_fisheye = is_one_of(&FISHEYE) || self.value("is_fisheye").as_bool() == Some(true);
        let get = |key: &str| self.number(key).map(|v| v.unwrap_or(0.0));
        let k = [get("k1")?, get("k2")?, get("k3")?, get("k4")?];
        let (k5, k6) = (self.number("k5")?, self.number("k6")?);
        let tangential = [get("p1")?, get("p2")?];
        let [fifth, sixth] = [k5, k6].map(|k| k.unwrap_or(0.0));
        if is_fisheye {
            for (key, value) in [("k5", fifth), ("k6", sixth)] {
                if value != 0.0 {
                    let expected = "0: a fisheye lens has k1 to k4";
                    return Err(InputError::new(self.file, key, value, expected));
                }
            }
            return Ok(Lens { tangential, ..Lens::fisheye(k) });
        }
        if k5.is_some() || k6.is_some() || is_one_of(&["FULL_OPENCV"]) {
            let lens = Lens::radial([k[0], k[1], k[2], 0.0]);
            return Ok(Lens { tangential, divisor: [k[3], fifth, sixth], ..lens });
        }
        Ok(Lens { tangential, ..Lens::radial(k) })
    }
}
