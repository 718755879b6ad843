//! Contact sheets: several images on one.

use crate::film::Film;

/// The space between images, in pixels.
const GAP: u32 = 4;

/// The radiance of the gaps, in every channel: a dark grey.
const GAP_RADIANCE: f32 = 0.02;

/// One image that shows `rows` of images from top to bottom, each row from left to right.
///
/// Images are 4 pixels apart and are aligned with the left side and with the top of their row.
/// The rest is dark grey. A row is as high as its highest image. The sheet has at least 1 × 1
/// pixels, also without images.
pub fn contact_sheet(rows: &[Vec<Film>]) -> Film {
    let width = rows.iter().map(|row| row_width(row)).max().unwrap_or(1).max(1);
    let height =
        rows.iter().map(|row| row_height(row) + GAP).sum::<u32>().saturating_sub(GAP).max(1);
    let mut sheet = Film::new(width, height);
    sheet.pixels.fill([GAP_RADIANCE; 3]);
    let mut top = 0;
    for row in rows {
        let mut left = 0;
        for film in row {
            paste(&mut sheet, film, left, top);
            left += film.width + GAP;
        }
        top += row_height(row) + GAP;
    }
    sheet
}

fn row_width(row: &[Film]) -> u32 {
    row.iter().map(|film| film.width + GAP).sum::<u32>().saturating_sub(GAP)
}

fn row_height(row: &[Film]) -> u32 {
    row.iter().map(|film| film.height).max().unwrap_or(0)
}

/// Copies `film` into `sheet` with its upper left pixel at (`left`, `top`).
fn paste(sheet: &mut Film, film: &Film, left: u32, top: u32) {
    for y in 0..film.height {
        let start = ((top + y) * sheet.width + left) as usize;
        let line = (y * film.width) as usize..((y + 1) * film.width) as usize;
        sheet.pixels[start..start + film.width as usize].copy_from_slice(&film.pixels[line]);
    }
}
