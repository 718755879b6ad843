//! The picture of all reconstructions, `grid.png`.

use std::path::PathBuf;

use font8x8::UnicodeFonts;
use image::{Rgb, RgbImage};

use crate::report::metrics::metric;
use crate::report::result_table::{ResultTable, mean_alone};
use crate::report::results::CellResult;
use crate::report::sweep::Sweep;

/// Width and height of a letter, in pixels.
const LETTER: u32 = 8;

/// Height of a line of text, in pixels.
const LINE: u32 = 10;

/// Height of the text above a table's pictures, in pixels.
const HEAD: u32 = 4 * LINE;

/// Room around pictures and text, in pixels.
const MARGIN: u32 = 6;

const BLACK: Rgb<u8> = Rgb([0, 0, 0]);
const RED: Rgb<u8> = Rgb([200, 20, 20]);

/// Sizes in the grid, in pixels.
struct Layout {
    /// Height of a reconstruction.
    picture_height: u32,
    /// Width and height of a reconstruction with its numbers and margin.
    tile: (u32, u32),
    /// Width of the column with the rows' values.
    left: u32,
}

impl Layout {
    /// The layout for pictures of `width` × `height` pixels.
    fn new(tables: &[ResultTable], (width, height): (u32, u32)) -> Self {
        let values = tables.iter().flat_map(|t| &t.rows.values);
        let letters = values.map(|v| v.chars().count()).max().unwrap_or(0) as u32;
        let left = (LETTER * letters).max(LETTER * 9) + 2 * MARGIN;
        let tile = (width + MARGIN, height + 3 * LINE + MARGIN);
        Layout { picture_height: height, tile, left }
    }

    fn table_width(&self, table: &ResultTable) -> u32 {
        self.left + self.tile.0 * table.columns.values.len() as u32
    }

    fn table_height(&self, table: &ResultTable) -> u32 {
        HEAD + self.tile.1 * table.rows.values.len() as u32 + MARGIN
    }
}

/// Draws the tables of a sweep below each other. Each place of a table has the reconstruction of
/// the seed with the median Chamfer distance, and numbers of all its seeds.
///
/// `picture` gives the file of a result's picture.
pub(crate) fn grid(
    sweep: &Sweep,
    results: &[CellResult],
    picture: &dyn Fn(&CellResult) -> PathBuf,
) -> RgbImage {
    let tables = ResultTable::all(sweep);
    let any = results.iter().find_map(|result| image::open(picture(result)).ok());
    let size = any.map_or((96, 96), |image| (image.width(), image.height()));
    let layout = Layout::new(&tables, size);
    let width = tables.iter().map(|t| layout.table_width(t)).max().unwrap_or(1);
    let height = tables.iter().map(|t| layout.table_height(t)).sum::<u32>();
    let mut out = RgbImage::from_pixel(width.max(LETTER * 40), height.max(1), Rgb([255, 255, 255]));
    let mut top = 0;
    for table in &tables {
        draw_table(&mut out, table, &layout, top, results, picture);
        top += layout.table_height(table);
    }
    out
}

/// Draws a table with its upper edge at `top`.
fn draw_table(
    out: &mut RgbImage,
    table: &ResultTable,
    layout: &Layout,
    top: u32,
    results: &[CellResult],
    picture: &dyn Fn(&CellResult) -> PathBuf,
) {
    let axes = format!("{} v {} >", table.rows.parameter, table.columns.parameter);
    write(out, MARGIN, top + 2, &table.title, BLACK);
    write(out, MARGIN, top + LINE + 2, &axes, BLACK);
    let x = |column: usize| layout.left + layout.tile.0 * column as u32;
    for (c, column) in table.columns.values.iter().enumerate() {
        write(out, x(c), top + 3 * LINE - 2, column, BLACK);
    }
    for (r, row) in table.rows.values.iter().enumerate() {
        let y = top + HEAD + layout.tile.1 * r as u32;
        write(out, MARGIN, y + layout.picture_height / 2, row, BLACK);
        for (c, column) in table.columns.values.iter().enumerate() {
            let own = table.at(results, row, column);
            draw_tile(out, (x(c), y), layout.picture_height, &own, picture);
        }
    }
}

/// Draws one place of a table: a picture of this height, and three lines of numbers.
///
/// The status is in red in place of a missing picture, and the count of fits that converged is in
/// red unless all did.
fn draw_tile(
    out: &mut RgbImage,
    (x, y): (u32, u32),
    height: u32,
    results: &[&CellResult],
    picture: &dyn Fn(&CellResult) -> PathBuf,
) {
    let Some(median) = median(results) else { return };
    if let Ok(image) = image::open(picture(median)) {
        image::imageops::overlay(out, &image.to_rgb8(), x.into(), y.into());
    } else {
        write(out, x, y + height / 2, &median.status, RED);
    }
    let number = |name: &str| metric(name).map_or(String::new(), |m| mean_alone(results, m));
    let converged = results.iter().filter(|r| r.converged).count();
    let color = if converged == results.len() { BLACK } else { RED };
    let count = format!("{converged}/{} conv.", results.len());
    write(out, x, y + height + 2, &number("chamfer"), BLACK);
    write(out, x, y + height + 2 + LINE, &number("psnr"), BLACK);
    write(out, x, y + height + 2 + 2 * LINE, &count, color);
}

/// The result with the median Chamfer distance.
fn median<'a>(results: &[&'a CellResult]) -> Option<&'a CellResult> {
    let chamfer = metric("chamfer")?;
    let mut order = results.to_vec();
    order.sort_by(|a, b| a.number(chamfer).total_cmp(&b.number(chamfer)));
    order.get(order.len().saturating_sub(1) / 2).copied()
}

/// Writes text with its upper left corner at (x, y). Letters that the font lacks stay empty.
fn write(image: &mut RgbImage, x: u32, y: u32, text: &str, color: Rgb<u8>) {
    for (i, letter) in text.chars().enumerate() {
        let glyph = font8x8::BASIC_FONTS
            .get(letter)
            .or_else(|| font8x8::GREEK_FONTS.get(letter))
            .or_else(|| font8x8::LATIN_FONTS.get(letter));
        for (dy, bits) in glyph.unwrap_or_default().into_iter().enumerate() {
            for dx in (0..LETTER).filter(|dx| bits >> dx & 1 == 1) {
                let (px, py) = (x + LETTER * i as u32 + dx, y + dy as u32);
                if px < image.width() && py < image.height() {
                    image.put_pixel(px, py, color);
                }
            }
        }
    }
}
