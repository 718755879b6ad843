//! The `camera` object of a scene file.

#![warn(clippy::cast_possible_truncation)]

use glam::{DMat4, DVec2, DVec3};
use serde_json::Value;

use files::InputError;
use files::json::{Object, numbers};
use render::Camera;

type Result<T> = std::result::Result<T, InputError>;

/// Film size, focal lengths and principal point in pixels.
struct Intrinsics {
    width: u32,
    height: u32,
    focal: DVec2,
    principal: DVec2,
}

/// Reads the object: intrinsics, and a pose as a matrix or as `eye`, `target` and `up`.
pub(crate) fn read(object: Object<'_>) -> Result<Camera> {
    let intrinsics = read_intrinsics(&object)?;
    let camera = match object.optional("pose") {
        Some(pose) => from_matrix(&object, &intrinsics, pose)?,
        None => from_target(&object, &intrinsics)?,
    };
    object.finish()?;
    Ok(camera)
}

fn read_intrinsics(object: &Object<'_>) -> Result<Intrinsics> {
    let (width, height) = (object.size("width")?, object.size("height")?);
    let focal = match object.optional("focal") {
        Some(value) if value.is_array() => DVec2::from(object.numbers::<2>("focal")?),
        _ => DVec2::splat(object.number("focal")?),
    };
    if focal.min_element() <= 0.0 {
        return Err(object.error("focal", "a focal length above 0, in pixels"));
    }
    let principal = DVec2::from(object.numbers("principal")?);
    Ok(Intrinsics { width, height, focal, principal })
}

/// A camera from its camera-to-world matrix, rows first.
fn from_matrix(object: &Object<'_>, intrinsics: &Intrinsics, pose: &Value) -> Result<Camera> {
    let Intrinsics { width, height, focal, principal } = *intrinsics;
    let rows = pose.as_array().filter(|rows| rows.len() == 4);
    let rows: Option<Vec<[f64; 4]>> = rows.and_then(|rows| rows.iter().map(numbers).collect());
    let expected = "a 4 x 4 camera-to-world matrix, row-major, whose upper 3 x 3 is a rotation";
    rows.and_then(|r| {
        let matrix = DMat4::from_cols_array_2d(&[r[0], r[1], r[2], r[3]]).transpose();
        Camera::from_pose(width, height, focal, principal, matrix)
    })
    .ok_or_else(|| object.error("pose", expected))
}

/// A camera at `eye` that looks at `target`.
fn from_target(object: &Object<'_>, intrinsics: &Intrinsics) -> Result<Camera> {
    let Intrinsics { width, height, focal, principal } = *intrinsics;
    let eye = DVec3::from(object.numbers("eye")?);
    let (target, up) = (DVec3::from(object.numbers("target")?), DVec3::from(object.numbers("up")?));
    if (target - eye).try_normalize().is_none() {
        return Err(object.error("target", "a point other than eye, at an ordinary distance"));
    }
    Camera::look_at(width, height, focal, principal, eye, target, up).ok_or_else(|| {
        object.error("up", "a direction of ordinary length, other than from eye to target")
    })
}
