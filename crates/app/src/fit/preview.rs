//! Pictures of a fit, for people.

use std::path::Path;

use crate::estimate::{Setup, render};
use crate::film::{Film, srgb_decode, srgb_encode};
use crate::io::write_image;
use crate::scene::{Appearance, AppearanceModel};

/// Places pictures side by side in rows; all of one row have one height, gaps are dark.
pub fn contact_sheet(rows: &[Vec<Film>]) -> Film {
    const GAP: u32 = 4;
    let row_width = |row: &Vec<Film>| row.iter().map(|f| f.width + GAP).sum::<u32>().saturating_sub(GAP);
    let row_height = |row: &Vec<Film>| row.iter().map(|f| f.height).max().unwrap_or(0);
    let width = rows.iter().map(row_width).max().unwrap_or(1).max(1);
    let height = rows.iter().map(|r| row_height(r) + GAP).sum::<u32>().saturating_sub(GAP).max(1);
    let mut sheet = Film::new(width, height);
    sheet.pixels.fill([0.02; 3]);
    let mut top = 0;
    for row in rows {
        let mut left = 0;
        for film in row {
            for y in 0..film.height {
                let start = ((top + y) * width + left) as usize;
                let line = (y * film.width) as usize..((y + 1) * film.width) as usize;
                sheet.pixels[start..start + film.width as usize].copy_from_slice(&film.pixels[line]);
            }
            left += film.width + GAP;
        }
        top += row_height(row) + GAP;
    }
    sheet
}

/// The unit normals seen by a camera, as colours n/2 + 1/2 in display space, black where nothing is hit.
///
/// # Errors
/// If the field gives a NaN or an infinity.
pub fn normal_map(setup: &Setup<'_, f32>, camera: usize) -> anyhow::Result<Film> {
    let normal = AppearanceModel { appearance: Appearance::Normal, parameters: Vec::new(), pointers: Vec::new() };
    let shader = normal.build::<f32>(setup.field, setup.bounds)?;
    let setup = Setup { shader: &*shader, background: glam::Vec3::ZERO, ..*setup };
    let mut film = render(&setup, camera, 1, 0, &|_| {})?.film;
    film.pixels.iter_mut().for_each(|p| *p = p.map(srgb_decode));
    Ok(film)
}

/// The size of the difference in display space, as a grey picture, twice as bright as it is.
pub fn difference(a: &Film, b: &Film) -> Film {
    let pixels = a.pixels.iter().zip(&b.pixels).map(|(a, b)| {
        let error = (0..3).map(|c| (srgb_encode(a[c]) - srgb_encode(b[c])).abs()).sum::<f32>() / 3.0;
        [srgb_decode((2.0 * error).min(1.0)); 3]
    });
    Film { width: a.width, height: a.height, pixels: pixels.collect() }
}

/// Writes target, render, normals and error of one view.
///
/// # Errors
/// If the field is not finite or the picture cannot be written.
pub fn write_preview(path: &Path, setup: &Setup<'_, f32>, camera: usize, target: &Film) -> anyhow::Result<Film> {
    let image = render(setup, camera, 1, 0, &|_| {})?.film;
    let normals = normal_map(setup, camera)?;
    let error = difference(&image, target);
    write_image(path, &contact_sheet(&[vec![target.clone(), image.clone(), normals, error]]))?;
    Ok(image)
}
