//! Pictures side by side.

use crate::Film;

/// Places pictures side by side in rows; all of one row have one height, gaps are dark.
pub fn contact_sheet(rows: &[Vec<Film>]) -> Film {
    const GAP: u32 = 4;
    let row_width =
        |row: &Vec<Film>| row.iter().map(|f| f.width + GAP).sum::<u32>().saturating_sub(GAP);
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
                sheet.pixels[start..start + film.width as usize]
                    .copy_from_slice(&film.pixels[line]);
            }
            left += film.width + GAP;
        }
        top += row_height(row) + GAP;
    }
    sheet
}
