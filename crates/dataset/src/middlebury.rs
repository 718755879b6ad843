//! Middlebury multi-view data sets: `*_par.txt` with the images beside it.

use std::path::Path;

use glam::{DMat3, DVec2, DVec3};

use super::lens::Lens;
use super::neus::camera_to_world;
use super::{Found, Pending, pose_fault};
use io::InputError;
use io::image_size;
use render::Camera;

type Result<T> = std::result::Result<T, InputError>;

/// Reads the camera file: a count, then a line a view with name, K (9), R (9) and t (3).
pub(super) fn read(folder: &Path, file: &Path) -> Result<Found> {
    let text = std::fs::read_to_string(file)
        .map_err(|e| InputError::new(file, "file", e, "a readable text file"))?;
    let mut lines = text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty());
    let (_, first) = lines
        .next()
        .ok_or_else(|| InputError::new(file, "line 1", "nothing", "the number of views"))?;
    let count: usize = first
        .trim()
        .parse()
        .map_err(|_| InputError::new(file, "line 1", first, "the number of views"))?;
    let train: Result<Vec<Pending>> =
        lines.map(|(i, line)| read_line(folder, file, i + 1, line)).collect();
    let train = train?;
    if train.len() != count || count == 0 {
        return Err(InputError::new(
            file,
            "views",
            train.len(),
            format!("{count}, as line 1 says, and not 0"),
        ));
    }
    let format =
        "Middlebury cameras: P = K [R t], OpenCV axes, origin at the image's top left corner"
            .to_owned();
    Ok(Found { format, train, test: None, bounds: None, points: Vec::new() })
}

fn read_line(folder: &Path, file: &Path, number: usize, line: &str) -> Result<Pending> {
    let at = format!("line {number}");
    let mut words = line.split_whitespace();
    let name = words.next().unwrap_or_default();
    let numbers: Vec<f64> = words.map(|w| w.parse().unwrap_or(f64::NAN)).collect();
    if numbers.len() != 21 || numbers.iter().any(|v| !v.is_finite()) {
        let found = match numbers.iter().position(|v| !v.is_finite()) {
            Some(i) => format!("number {} that is not finite", i + 1),
            None => format!("{} numbers", numbers.len()),
        };
        return Err(InputError::new(file, at, found, "a name and 21 finite numbers: K, R, t"));
    }
    let rows = |start: usize| DMat3::from_cols_slice(&numbers[start..start + 9]).transpose();
    let (k, r, t) = (rows(0), rows(9), DVec3::from_slice(&numbers[18..]));
    let path = folder.join(name);
    let (width, height) = image_size(&path)?;
    let (focal, principal) = (DVec2::new(k.x_axis.x, k.y_axis.y), k.z_axis.truncate());
    if focal.min_element() <= 0.0 || k.row(2) != DVec3::Z || k.x_axis.y != 0.0 {
        let kind = if k.determinant() == 0.0 { "a singular K" } else { "a K that is no pinhole's" };
        let found = format!("{kind}, {:?}", &numbers[..9]);
        return Err(InputError::new(
            file,
            at,
            found,
            "K = [fx, s, cx, 0, fy, cy, 0, 0, 1] with fx and fy above 0",
        ));
    }
    let rotation = r.transpose();
    let pose = camera_to_world(rotation.x_axis, rotation.y_axis, rotation.z_axis, -(rotation * t));
    let camera = Camera::from_pose(width, height, focal, principal, pose).ok_or_else(|| {
        InputError::new(file, at, format!("R with {}", pose_fault(pose)), "a rotation R")
    })?;
    let lens = Lens { skew: k.y_axis.x, ..Lens::default() };
    Ok(Pending {
        name: name.to_owned(),
        path,
        mask: None,
        camera,
        lens,
        size_from: "the image".to_owned(),
    })
}
