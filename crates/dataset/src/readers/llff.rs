//! LLFF data sets: `poses_bounds.npy` with `images/` (Mildenhall et al., "Local Light Field Fusion:
//! Practical View Synthesis with Prescriptive Sampling Guidelines", ACM TOG 38(4), 2019).
//!
//! Each of N rows has 17 numbers: a 3 × 5 matrix by rows, and the nearest and farthest depth. Its
//! first four columns are a camera-to-world pose with axes down, right, backwards. The fifth is the
//! full image's height and width and the focal length in pixels. The principal point is the
//! image's centre. Images have the order of their names.

use std::io::BufReader;
use std::path::Path;

use glam::{DMat4, DVec2, DVec3};

use crate::readers::images::{by_number, image_folder, images, images_in, positions};
use crate::readers::lens::Lens;
use crate::readers::pixels::whole_pixels;
use crate::readers::projection::placed;
use crate::readers::recognised::{Recognised, Views};
use crate::readers::result::Result;
use crate::readers::unread::UnreadView;
use files::InputError;
use render::Camera;

/// Numbers in a row.
const NUMBERS: usize = 17;

/// Bytes of memory for a row: its numbers, and a view.
const MEMORY_PER_ROW: u64 = 1024;

const EXPECTED: &str = "an N x 17 array of finite floats";

/// Reads the poses and pairs them with the images in the order of their names.
pub(crate) fn read(folder: &Path) -> Result<Recognised> {
    let file = folder.join("poses_bounds.npy");
    let rows = rows(&file)?;
    let has_all = |path: &Path| images_in(path).is_ok_and(|found| found.len() == rows.len());
    let place = image_folder(&[folder], has_all).ok_or_else(|| {
        InputError::new(folder, "images", "no such folder", "a folder images or images_4")
    })?;
    let mut images = images(&place.path)?;
    let note = by_number(&mut images);
    let numbers = positions(&images, rows.len()).ok_or_else(|| {
        let (found, count) = (format!("{} rows", rows.len()), images.len());
        let expected = format!("{count}, one for each image in {}", place.path.display());
        InputError::new(&file, "array", found, expected)
    })?;
    let mut views = Views::default();
    for (path, i) in images.iter().zip(&numbers) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let Some((camera, scale)) = camera(&file, *i, &rows[*i])? else {
            views.unposed.push(path.clone());
            continue;
        };
        let view = UnreadView::of_image(name, path.clone(), camera, Lens::default());
        let view = view.with_pose_scale(scale);
        let size_source = Some("poses_bounds.npy".to_owned());
        views.found.push(UnreadView { size_source, ..view }.of_reduced_image()?);
    }
    let missing = (0..rows.len()).filter(|i| !numbers.contains(i));
    views.missing = missing.map(|i| place.path.join(format!("image {i}"))).collect();
    let format = "LLFF poses_bounds.npy: camera-to-world, axes down, right, backwards";
    let notes = note.into_iter().collect();
    Ok(Recognised { notes, ..Recognised::new(format, views) })
}

fn rows(file: &Path) -> Result<Vec<[f64; NUMBERS]>> {
    let error = |found: String| InputError::new(file, "array", found, EXPECTED);
    let (opened, length) = files::open(file, "array", EXPECTED)?;
    let npy = film::npy_reader(BufReader::new(opened)).map_err(|e| error(e.to_string()))?;
    let shape = npy.shape().to_vec();
    let &[count, 17] = shape.as_slice() else { return Err(error(format!("shape {shape:?}"))) };
    if count == 0 {
        return Err(error(format!("shape {shape:?}")));
    }
    // A row has 2 bytes a number at least.
    if count > length / (2 * NUMBERS as u64) {
        return Err(error(format!("a file that is cut short, of shape {shape:?}")));
    }
    files::check_memory(file, "array", format!("{count} rows"), count * MEMORY_PER_ROW)?;
    let numbers = film::npy_numbers(npy).map_err(|e| match e.kind() {
        std::io::ErrorKind::UnexpectedEof => error("a file that is cut short".to_owned()),
        _ => error(e.to_string()),
    })?;
    let (rows, _) = numbers.as_chunks::<NUMBERS>();
    Ok(rows.to_vec())
}

/// The camera of a row, of the full image, and the scale of its pose; `None` without a usable pose.
fn camera(file: &Path, i: usize, row: &[f64; NUMBERS]) -> Result<Option<(Camera, f64)>> {
    // The last two numbers are the depths of the points: they are not used.
    let pose = &row[..NUMBERS - 2];
    if pose.iter().any(|number| !number.is_finite()) || pose.iter().all(|number| *number == 0.0) {
        return Ok(None);
    }
    let error = |field: &str, found: String, expected: &str| {
        InputError::new(file, format!("row {i} {field}"), found, expected)
    };
    let column = |c: usize| DVec3::new(row[c], row[5 + c], row[10 + c]);
    let [height, width, focal] = column(4).to_array();
    let size = [width, height].map(whole_pixels);
    let ([Some(columns), Some(rows)], true) = (size, focal > 0.0) else {
        let found = format!("height {height}, width {width}, focal length {focal}");
        let expected = "whole pixels from 1 to 65535, and a focal length above 0";
        return Err(error("size", found, expected));
    };
    let [down, right, backwards, eye] = [0, 1, 2, 3].map(column);
    let pose = DMat4::from_cols(
        right.extend(0.0),
        (-down).extend(0.0),
        backwards.extend(0.0),
        eye.extend(1.0),
    );
    let principal = DVec2::new(width, height) / 2.0;
    placed([columns, rows], DVec2::splat(focal), principal, pose, |found| {
        error("pose", found, "a rotation (down, right, backwards) and an eye")
    })
}
