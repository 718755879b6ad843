//! Middlebury multi-view data sets: `*_par.txt` with the images beside it (Seitz et al., "A
//! Comparison and Evaluation of Multi-View Stereo Reconstruction Algorithms", CVPR 2006).
//!
//! Line 1 has the number of views. Each other line has an image's name and the numbers of K (9, by
//! rows), R (9, by rows) and t (3), with P = K [R t], OpenCV axes, and the film's origin at the
//! image's top left corner.

use std::path::Path;

use glam::{DMat3, DVec2, DVec3};

use crate::readers::lens::Lens;
use crate::readers::lookup::image_place;
use crate::readers::projection::{camera_to_world, placed};
use crate::readers::recognised::{Recognised, Views};
use crate::readers::result::Result;
use crate::readers::unread::UnreadView;
use files::InputError;
use film::image_size;
use render::Camera;

/// Numbers of K on a line.
const INTRINSICS: usize = 9;

/// Numbers on a line: K, R and t.
const NUMBERS: usize = INTRINSICS + 9 + 3;

/// Reads the camera file.
pub(super) fn read(folder: &Path, file: &Path) -> Result<Recognised> {
    let text = files::read_text(file, "file", "a readable text file")?;
    let mut lines = text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty());
    let no_count = |found: &str| InputError::new(file, "line 1", found, "the number of views");
    let (_, first) = lines.next().ok_or_else(|| no_count("nothing"))?;
    let count: usize = first.trim().parse().map_err(|_| no_count(first))?;
    let mut views = Views::default();
    for (i, line) in lines {
        Line { file, number: i + 1 }.read(folder, line, &mut views)?;
    }
    let found = views.found.len() + views.missing.len() + views.unposed.len();
    if found != count || count == 0 {
        let expected = format!("{count} (the number on line 1), at least 1");
        return Err(InputError::new(file, "views", found, expected));
    }
    let format =
        "Middlebury cameras: P = K [R t], OpenCV axes, origin at the image's top left corner";
    Ok(Recognised::new(format, views))
}

/// The place of a line, for messages.
struct Line<'a> {
    file: &'a Path,
    number: usize,
}

impl Line<'_> {
    fn error(&self, found: String, expected: &str) -> InputError {
        InputError::new(self.file, format!("line {}", self.number), found, expected)
    }

    fn read(&self, folder: &Path, line: &str, views: &mut Views) -> Result<()> {
        let mut words = line.split_whitespace();
        let name = words.next().unwrap_or_default();
        let numbers = self.numbers(words)?;
        views.add(image_place(folder, name), |path| {
            let found = self.camera(&numbers, image_size(&path)?)?;
            Ok(found.map(|(camera, scale, lens)| {
                UnreadView::of_image(name.to_owned(), path, camera, lens).with_pose_scale(scale)
            }))
        })
    }

    /// The 21 numbers after the name.
    fn numbers<'w>(&self, words: impl Iterator<Item = &'w str>) -> Result<Vec<f64>> {
        let words: Vec<&str> = words.collect();
        let number = |(i, word): (usize, &&str)| {
            // Only a pose may be none.
            let number = word.parse().ok().filter(|v: &f64| i >= INTRINSICS || v.is_finite());
            number.ok_or_else(|| format!("number {} that is not finite", i + 1))
        };
        let numbers =
            words.iter().enumerate().map(number).collect::<std::result::Result<Vec<_>, _>>();
        let found = match numbers {
            Err(found) => found,
            Ok(numbers) if numbers.len() != NUMBERS => format!("{} numbers", numbers.len()),
            Ok(numbers) => return Ok(numbers),
        };
        Err(self.error(found, "a name and 21 finite numbers: K, R, t"))
    }

    /// The camera, and its skew as a lens.
    fn camera(&self, numbers: &[f64], size: (u32, u32)) -> Result<Option<(Camera, f64, Lens)>> {
        let rows = |start: usize| DMat3::from_cols_slice(&numbers[start..start + 9]).transpose();
        let (k, r, t) = (rows(0), rows(9), DVec3::from_slice(&numbers[18..]));
        let (focal, principal) = (DVec2::new(k.x_axis.x, k.y_axis.y), k.z_axis.truncate());
        if focal.min_element() <= 0.0 || k.row(2) != DVec3::Z || k.x_axis.y != 0.0 {
            let singular = k.determinant() == 0.0;
            let kind = if singular { "a singular K" } else { "a K that no pinhole camera has" };
            let expected = "K = [fx, s, cx, 0, fy, cy, 0, 0, 1] with fx and fy above 0";
            return Err(self.error(format!("{kind}, {:?}", &numbers[..9]), expected));
        }
        let axes = r.transpose();
        let pose = camera_to_world(axes.x_axis, axes.y_axis, axes.z_axis, -(axes * t));
        let lens = Lens { skew: k.y_axis.x, ..Lens::default() };
        let wrong = |fault| self.error(format!("R with {fault}"), "a rotation R");
        let placed = placed(size.into(), focal, principal, pose, wrong)?;
        Ok(placed.map(|(camera, scale)| (camera, scale, lens)))
    }
}
