//! NeRF/Blender data sets: `transforms*.json`.

use std::path::{Path, PathBuf};

use glam::{DMat4, DVec2};
use serde_json::Value;

use super::lens::Lens;
use super::{Found, Pending, pose_fault};
use io::InputError;
use io::image_size;
use io::json::{numbers, shown};
use render::Camera;

type Result<T> = std::result::Result<T, InputError>;

/// Reads the frames of the first file, and of its `_test` or `_val` sibling as held-out views.
pub(super) fn read(folder: &Path, files: &[PathBuf]) -> Result<Found> {
    let train = frames(folder, &files[0])?;
    let split = files[0].file_name().is_some_and(|n| n == "transforms_train.json");
    let sibling = ["transforms_test.json", "transforms_val.json"]
        .map(|n| folder.join(n))
        .into_iter()
        .find(|p| p.exists());
    let test = match sibling.filter(|_| split) {
        Some(path) => Some(frames(folder, &path)?),
        None => None,
    };
    let format =
        "NeRF/Blender transforms: camera-to-world, x right, y up, looking along -z".to_owned();
    Ok(Found { format, train, test, bounds: None, points: Vec::new() })
}

fn frames(folder: &Path, file: &Path) -> Result<Vec<Pending>> {
    let text = std::fs::read_to_string(file)
        .map_err(|e| InputError::new(file, "file", e, "a readable file"))?;
    let root: Value = serde_json::from_str(&text).map_err(|e| {
        InputError::new(file, format!("line {} column {}", e.line(), e.column()), e, "JSON")
    })?;
    let frames = root["frames"].as_array().filter(|f| !f.is_empty());
    let frames = frames.ok_or_else(|| {
        InputError::new(file, "frames", shown(&root["frames"]), "an array with frames")
    })?;
    frames.iter().enumerate().map(|(i, frame)| read_frame(folder, file, &root, frame, i)).collect()
}

/// A number of the frame, or of the whole file.
fn number(file: &Path, root: &Value, frame: &Value, key: &str, at: &str) -> Result<Option<f64>> {
    let (value, place) = if frame[key].is_null() {
        (&root[key], key.to_owned())
    } else {
        (&frame[key], format!("{at}/{key}"))
    };
    if value.is_null() {
        return Ok(None);
    }
    let number = value.as_f64().filter(|v| v.is_finite());
    number.map(Some).ok_or_else(|| InputError::new(file, place, shown(value), "a finite number"))
}

fn read_frame(
    folder: &Path,
    file: &Path,
    root: &Value,
    frame: &Value,
    i: usize,
) -> Result<Pending> {
    let at = format!("frames/{i}");
    let get = |key: &str| number(file, root, frame, key, &at);
    let name = frame["file_path"].as_str().ok_or_else(|| {
        InputError::new(
            file,
            format!("{at}/file_path"),
            shown(&frame["file_path"]),
            "a file's name",
        )
    })?;
    let path = image_path(folder, name).ok_or_else(|| {
        InputError::new(
            folder.join(name),
            "image",
            "no such file",
            format!("the image of {at} in {}", file.display()),
        )
    })?;
    let lens = lens(file, root, frame, &at)?;
    let (width, height) = size(file, &path, [get("w")?, get("h")?])?;
    let focal = focal(
        file,
        width,
        [get("fl_x")?, get("fl_y")?, get("camera_angle_x")?, get("camera_angle_y")?],
        height,
    )?;
    let center = DVec2::new(f64::from(width), f64::from(height)) / 2.0;
    let principal = DVec2::new(get("cx")?.unwrap_or(center.x), get("cy")?.unwrap_or(center.y));
    let pose = pose(file, &frame["transform_matrix"], &at)?;
    let camera = Camera::from_pose(width, height, focal, principal, pose).ok_or_else(|| {
        let expected = "a camera-to-world matrix whose upper 3 x 3 is a rotation";
        InputError::new(file, format!("{at}/transform_matrix"), pose_fault(pose), expected)
    })?;
    let mask = match &frame["mask_path"] {
        Value::Null => sibling_mask(folder, name),
        Value::String(mask) => Some(image_path(folder, mask).unwrap_or_else(|| folder.join(mask))),
        other => {
            return Err(InputError::new(
                file,
                format!("{at}/mask_path"),
                shown(other),
                "a file's name",
            ));
        }
    };
    let size_from = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Pending {
        name: name.trim_start_matches("./").to_owned(),
        path,
        mask,
        camera,
        lens,
        size_from,
    })
}

/// Width and height in pixels: as the file says, or the image.
fn size(file: &Path, image: &Path, said: [Option<f64>; 2]) -> Result<(u32, u32)> {
    let (width, height) = if said.contains(&None) { image_size(image)? } else { (0, 0) };
    let pick = |said: Option<f64>, key: &str, of_image: u32| match said {
        None => Ok(of_image),
        Some(n) if n >= 1.0 && n <= f64::from(u16::MAX) && n.fract() == 0.0 => Ok(n as u32),
        Some(n) => Err(InputError::new(file, key, n, "a whole number of pixels from 1 to 65535")),
    };
    Ok((pick(said[0], "w", width)?, pick(said[1], "h", height)?))
}

/// Distortion as instant-ngp and nerfstudio write it: OPENCV's k1, k2, p1, p2, per file or frame.
fn lens(file: &Path, root: &Value, frame: &Value, at: &str) -> Result<Lens> {
    let get = |key: &str| number(file, root, frame, key, at).map(|v| v.unwrap_or(0.0));
    let of = |key: &str| if frame[key].is_null() { &root[key] } else { &frame[key] };
    let model = of("camera_model");
    let known = ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"];
    if !model.is_null()
        && !model.as_str().is_some_and(|m| known.contains(&m.to_uppercase().as_str()))
    {
        return Err(InputError::new(file, "camera_model", shown(model), known.join(", ")));
    }
    if of("is_fisheye").as_bool() == Some(true) {
        return Err(InputError::new(
            file,
            "is_fisheye",
            "true",
            "a perspective lens (undistort the images first)",
        ));
    }
    for key in ["k3", "k4"] {
        if get(key)? != 0.0 {
            return Err(InputError::new(
                file,
                key,
                get(key)?,
                "0: only k1, k2, p1 and p2 are modelled",
            ));
        }
    }
    Ok(Lens { radial: [get("k1")?, get("k2")?], tangential: [get("p1")?, get("p2")?], skew: 0.0 })
}

fn focal(
    file: &Path,
    width: u32,
    [fl_x, fl_y, angle_x, angle_y]: [Option<f64>; 4],
    height: u32,
) -> Result<DVec2> {
    let from_angle = |size: u32, angle: f64| 0.5 * f64::from(size) / (0.5 * angle).tan();
    let x = fl_x.or(angle_x.map(|a| from_angle(width, a)));
    let y = fl_y.or(angle_y.map(|a| from_angle(height, a))).or(x);
    match (x, y) {
        (Some(x), Some(y)) if x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite() => {
            Ok(DVec2::new(x, y))
        }
        (Some(x), y) => {
            let found = format!("focal lengths {x}, {}", y.unwrap_or(x));
            let expected = "focal lengths above 0 (angles between 0 and pi)";
            Err(InputError::new(
                file,
                if fl_x.is_some() { "fl_x" } else { "camera_angle_x" },
                found,
                expected,
            ))
        }
        (None, _) => Err(InputError::new(
            file,
            "camera_angle_x",
            "nothing",
            "camera_angle_x, or fl_x in pixels",
        )),
    }
}

fn pose(file: &Path, value: &Value, at: &str) -> Result<DMat4> {
    let error = || {
        InputError::new(
            file,
            format!("{at}/transform_matrix"),
            shown(value),
            "a 4 x 4 matrix of finite numbers, row-major",
        )
    };
    let rows = value.as_array().filter(|r| r.len() == 4 || r.len() == 3).ok_or_else(error)?;
    let rows: Option<Vec<[f64; 4]>> = rows.iter().map(numbers).collect();
    let r = rows.ok_or_else(error)?;
    if r.get(3).is_some_and(|last| *last != [0.0, 0.0, 0.0, 1.0]) {
        let found = format!("last row {:?}", r[3]);
        return Err(InputError::new(
            file,
            format!("{at}/transform_matrix"),
            found,
            "last row [0, 0, 0, 1] (row-major)",
        ));
    }
    Ok(DMat4::from_cols_array_2d(&[r[0], r[1], r[2], [0.0, 0.0, 0.0, 1.0]]).transpose())
}

/// The file of an image that may be named without its extension.
fn image_path(folder: &Path, name: &str) -> Option<PathBuf> {
    let plain = folder.join(name);
    let with = ["png", "jpg", "jpeg", "exr"].map(|e| folder.join(format!("{name}.{e}")));
    std::iter::once(plain).chain(with).find(|p| p.is_file())
}

/// `masks/train/r_000.png` for `./train/r_000`.
fn sibling_mask(folder: &Path, name: &str) -> Option<PathBuf> {
    let name = name.trim_start_matches("./");
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    [name, stem].into_iter().find_map(|n| image_path(&folder.join("masks"), n))
}
