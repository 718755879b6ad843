//! Pictures of a sweep: the grid of reconstructions, heat maps, curves.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use font8x8::UnicodeFonts;
use image::{Rgb, RgbImage};

use super::results::{Metric, Row, metric};
use super::statistics::mean;
use super::sweep::Sweep;
use measure::plot::{Curve, Panel, escape, svg};

/// A table of the sweep: a data set, with the values of the parameters that are neither rows nor
/// columns.
pub(super) struct Table {
    pub(super) title: String,
    data: String,
    rest: Vec<(String, String)>,
    pub(super) rows: (String, Vec<String>),
    pub(super) columns: (String, Vec<String>),
}

impl Table {
    /// All tables of a sweep.
    pub(super) fn all(sweep: &Sweep) -> Vec<Table> {
        let (rows, columns) = sweep.axes();
        let of = |key: &str| (key.to_owned(), sweep.values(key));
        let columns = columns.map_or((String::new(), vec![String::new()]), |key| of(&key));
        let mut rests: Vec<Vec<(String, String)>> = vec![Vec::new()];
        for key in sweep.parameters.keys().filter(|k| **k != rows && **k != columns.0) {
            let with = |rest: &Vec<(String, String)>, v: String| {
                [rest.clone(), vec![(key.clone(), v)]].concat()
            };
            rests = rests
                .iter()
                .flat_map(|rest| sweep.values(key).into_iter().map(move |v| with(rest, v)))
                .collect();
        }
        let mut tables = Vec::new();
        for data in &sweep.data {
            for rest in &rests {
                let settings: Vec<String> =
                    rest.iter().map(|(k, v)| format!(", {k} = {v}")).collect();
                let title = format!("{}{}", data.name, settings.concat());
                let (rows, columns) = (of(&rows), columns.clone());
                tables.push(Table {
                    title,
                    data: data.name.clone(),
                    rest: rest.clone(),
                    rows,
                    columns,
                });
            }
        }
        tables
    }

    /// The rows of one place, a seed each.
    pub(super) fn at<'a>(&self, rows: &'a [Row], row: &str, column: &str) -> Vec<&'a Row> {
        let fits = |r: &&Row| {
            r.data == self.data
                && self.rest.iter().all(|(k, v)| r.value(k) == v)
                && r.value(&self.rows.0) == row
                && (self.columns.0.is_empty() || r.value(&self.columns.0) == column)
        };
        rows.iter().filter(fits).collect()
    }
}

/// The mean of a metric over rows, as people read it.
pub(super) fn shown(rows: &[&Row], metric: &Metric) -> String {
    let values: Vec<f64> =
        rows.iter().filter_map(|r| r.numbers.get(metric.name).copied()).collect();
    if values.is_empty() {
        return "-".to_owned();
    }
    let missing = if values.len() < rows.len() {
        format!(" ({} of {})", values.len(), rows.len())
    } else {
        String::new()
    };
    let (factor, unit) = metric.shown;
    let found = mean(&values.iter().map(|v| v * factor).collect::<Vec<_>>());
    let half = found.high - found.mean;
    if half.is_finite() && values.len() > 1 {
        format!("{} ± {}{unit}{missing}", three(found.mean), three(half))
    } else {
        format!("{}{unit}{missing}", three(found.mean))
    }
}

/// Three digits.
pub(super) fn three(v: f64) -> String {
    let decimals = if v == 0.0 || !v.is_finite() {
        0
    } else {
        (2 - v.abs().log10().floor() as i32).clamp(0, 6)
    };
    format!("{v:.*}", decimals as usize)
}

const LINE: u32 = 10;

/// What stands above a table's pictures.
const HEAD: u32 = 4 * LINE;
const MARGIN: u32 = 6;
const BLACK: Rgb<u8> = Rgb([0, 0, 0]);
const RED: Rgb<u8> = Rgb([200, 20, 20]);

/// Writes text of 8 × 8 pixels a letter; what the font does not have is left out.
fn write(image: &mut RgbImage, x: u32, y: u32, text: &str, color: Rgb<u8>) {
    for (i, letter) in text.chars().enumerate() {
        let glyph = font8x8::BASIC_FONTS
            .get(letter)
            .or_else(|| font8x8::GREEK_FONTS.get(letter))
            .or_else(|| font8x8::LATIN_FONTS.get(letter));
        for (dy, bits) in glyph.unwrap_or_default().into_iter().enumerate() {
            for dx in (0..8).filter(|dx| bits >> dx & 1 == 1) {
                let (px, py) = (x + 8 * i as u32 + dx, y + dy as u32);
                if px < image.width() && py < image.height() {
                    image.put_pixel(px, py, color);
                }
            }
        }
    }
}

/// Reconstructions in rows and columns, each with its numbers: the seed with the median Chamfer
/// distance.
pub(super) fn grid(sweep: &Sweep, rows: &[Row], picture: &dyn Fn(&Row) -> PathBuf) -> RgbImage {
    let tables = Table::all(sweep);
    let any = rows.iter().find_map(|row| image::open(picture(row)).ok());
    let (tile_width, tile_height) = any.map_or((96, 96), |image| (image.width(), image.height()));
    let (cell_width, cell_height) = (tile_width + MARGIN, tile_height + 3 * LINE + MARGIN);
    let left =
        8 * tables.iter().flat_map(|t| &t.rows.1).map(|v| v.chars().count()).max().unwrap_or(0)
            as u32;
    let left = left.max(8 * 9) + 2 * MARGIN;
    let across = |t: &Table| left + cell_width * t.columns.1.len() as u32;
    let down = |t: &Table| HEAD + cell_height * t.rows.1.len() as u32 + MARGIN;
    let (width, height) =
        (tables.iter().map(across).max().unwrap_or(1), tables.iter().map(down).sum::<u32>());
    let mut out = RgbImage::from_pixel(width.max(8 * 40), height.max(1), Rgb([255, 255, 255]));
    let mut top = 0;
    for table in &tables {
        write(&mut out, MARGIN, top + 2, &table.title, BLACK);
        write(
            &mut out,
            MARGIN,
            top + LINE + 2,
            &format!("{} v {} >", table.rows.0, table.columns.0),
            BLACK,
        );
        for (c, column) in table.columns.1.iter().enumerate() {
            write(&mut out, left + cell_width * c as u32, top + 3 * LINE - 2, column, BLACK);
        }
        for (r, value) in table.rows.1.iter().enumerate() {
            let y = top + HEAD + cell_height * r as u32;
            write(&mut out, MARGIN, y + tile_height / 2, value, BLACK);
            for (c, column) in table.columns.1.iter().enumerate() {
                let own = table.at(rows, value, column);
                tile(&mut out, (left + cell_width * c as u32, y), tile_height, &own, picture);
            }
        }
        top += down(table);
    }
    out
}

fn tile(
    out: &mut RgbImage,
    (x, y): (u32, u32),
    height: u32,
    rows: &[&Row],
    picture: &dyn Fn(&Row) -> PathBuf,
) {
    let Some(chamfer) = metric("chamfer") else { return };
    let mut order = rows.to_vec();
    order.sort_by(|a, b| a.number(chamfer).total_cmp(&b.number(chamfer)));
    let Some(middle) = order.get(order.len().saturating_sub(1) / 2) else { return };
    if let Ok(image) = image::open(picture(middle)) {
        image::imageops::overlay(out, &image.to_rgb8(), x.into(), y.into());
    } else {
        write(out, x, y + height / 2, &middle.status, RED);
    }
    let number = |name: &str| metric(name).map_or(String::new(), |m| plain(rows, m));
    let converged = rows.iter().filter(|r| r.converged).count();
    let color = if converged == rows.len() { BLACK } else { RED };
    write(out, x, y + height + 2, &number("chamfer"), BLACK);
    write(out, x, y + height + 2 + LINE, &number("psnr"), BLACK);
    write(out, x, y + height + 2 + 2 * LINE, &format!("{converged}/{} conv.", rows.len()), color);
}

/// The mean alone.
fn plain(rows: &[&Row], metric: &Metric) -> String {
    let values: Vec<f64> =
        rows.iter().filter_map(|r| r.numbers.get(metric.name).copied()).collect();
    let (factor, unit) = metric.shown;
    let found = mean(&values).mean * factor;
    if values.is_empty() { "-".to_owned() } else { format!("{}{unit}", three(found)) }
}

/// Metrics over rows and columns as colours, logarithmic where they are errors.
pub(super) fn heat_map(sweep: &Sweep, rows: &[Row], metrics: &[&Metric]) -> String {
    const SIDE: (f64, f64) = (64.0, 30.0);
    let tables = Table::all(sweep);
    let columns = tables.iter().map(|t| t.columns.1.len()).max().unwrap_or(1) as f64;
    let lines = tables.iter().map(|t| t.rows.1.len()).max().unwrap_or(1) as f64;
    let (wide, high) = (columns * SIDE.0 + 120.0, lines * SIDE.1 + 60.0);
    let (width, height) = (wide * metrics.len() as f64, high * tables.len() as f64);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"10\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    for (m, metric) in metrics.iter().enumerate() {
        for (t, table) in tables.iter().enumerate() {
            let (x0, y0) = (m as f64 * wide + 100.0, t as f64 * high + 40.0);
            let places =
                || table.rows.1.iter().flat_map(|r| table.columns.1.iter().map(move |c| (r, c)));
            let value = |r: &str, c: &str| {
                let own: Vec<f64> =
                    table.at(rows, r, c).iter().map(|row| row.number(metric)).collect();
                mean(&own).mean
            };
            let level = |v: f64| {
                if metric.name == "psnr" { -v / 20.0 } else { v.max(metric.least).log10() }
            };
            let levels = || places().map(|(r, c)| value(r, c)).filter(|v| v.is_finite()).map(level);
            let (low, most) = (
                levels().fold(f64::INFINITY, f64::min),
                levels().fold(f64::NEG_INFINITY, f64::max),
            );
            let _ = writeln!(
                out,
                "<text x=\"{x0}\" y=\"{}\" font-weight=\"bold\">{}: {}</text><text x=\"{x0}\" y=\"{}\">{} ↓ {} →</text>",
                y0 - 26.0,
                escape(&table.title),
                metric.label,
                y0 - 14.0,
                table.rows.0,
                table.columns.0
            );
            for (r, row) in table.rows.1.iter().enumerate() {
                let y = y0 + r as f64 * SIDE.1;
                let _ = writeln!(
                    out,
                    "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>",
                    x0 - 6.0,
                    y + 0.6 * SIDE.1,
                    escape(row)
                );
                for (c, column) in table.columns.1.iter().enumerate() {
                    let (x, v) = (x0 + c as f64 * SIDE.0, value(row, column));
                    let part = ((level(v) - low) / (most - low).max(1e-9)).clamp(0.0, 1.0);
                    let known = (120.0 + 125.0 * part, 190.0 - 90.0 * part, 130.0 - 50.0 * part);
                    let (red, green, blue) =
                        if v.is_finite() { known } else { (224.0, 224.0, 224.0) };
                    let text = if v.is_finite() {
                        three(v * metric.shown.0) + metric.shown.1
                    } else {
                        "-".into()
                    };
                    let _ = writeln!(
                        out,
                        "<rect x=\"{x}\" y=\"{y}\" width=\"{}\" height=\"{}\" fill=\"rgb({red:.0},{green:.0},{blue:.0})\"/>\
                         <text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{text}</text>",
                        SIDE.0 - 2.0,
                        SIDE.1 - 2.0,
                        x + 0.5 * SIDE.0,
                        y + 0.6 * SIDE.1
                    );
                }
            }
            for (c, column) in table.columns.1.iter().enumerate() {
                let x = x0 + (c as f64 + 0.5) * SIDE.0;
                let _ = writeln!(
                    out,
                    "<text x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                    y0 - 3.0,
                    escape(column)
                );
            }
        }
    }
    out + "</svg>\n"
}

/// Losses over iterations: a panel a row of a table, a curve a column.
pub(super) fn curves(sweep: &Sweep, rows: &[Row]) -> String {
    let mut panels = Vec::new();
    for table in Table::all(sweep) {
        for row in &table.rows.1 {
            let curve = |column: &String| {
                let all = table.at(rows, row, column);
                let length = all.iter().map(|r| r.curve.len()).max().unwrap_or(0);
                // What was ended early has other iterations.
                let own: Vec<&&Row> = all.iter().filter(|r| r.curve.len() == length).collect();
                let point = |i: usize| {
                    let at = own[0].curve[i].0.max(1.0);
                    (at, mean(&own.iter().map(|r| r.curve[i].1).collect::<Vec<_>>()).mean)
                };
                let points =
                    (0..length).map(point).filter(|p| p.1 > 0.0 && p.1.is_finite()).collect();
                Curve { name: format!("{} {column}", table.columns.0), points }
            };
            let title = format!("{}, {} = {row}", table.title, table.rows.0);
            panels.push(Panel {
                title,
                curves: table.columns.1.iter().map(curve).collect(),
                front: false,
            });
        }
    }
    svg(&panels, "iteration", "loss")
}

/// Chamfer distance over seconds: a panel a table, a curve a row, and behind them the front.
pub(super) fn pareto(sweep: &Sweep, rows: &[Row]) -> String {
    let mut panels = Vec::new();
    for table in Table::all(sweep) {
        let curve = |row: &String| {
            let point = |column: &String| {
                let own = table.at(rows, row, column);
                let of = |name: &str| {
                    mean(
                        &own.iter()
                            .filter_map(|r| r.numbers.get(name).copied())
                            .collect::<Vec<_>>(),
                    )
                    .mean
                };
                (of("seconds"), of("chamfer"))
            };
            let finite =
                |p: &(f64, f64)| p.0 > 0.0 && p.1 > 0.0 && p.0.is_finite() && p.1.is_finite();
            let points = table.columns.1.iter().map(point).filter(finite).collect();
            Curve { name: format!("{} {row}", table.rows.0), points }
        };
        let curves = table.rows.1.iter().map(curve).collect();
        panels.push(Panel { title: table.title.clone(), curves, front: true });
    }
    svg(&panels, "seconds", "Chamfer distance, bounding radii")
}

/// Writes the pictures into a folder; their file names.
pub(super) fn save(
    sweep: &Sweep,
    rows: &[Row],
    folder: &Path,
    picture: &dyn Fn(&Row) -> PathBuf,
) -> anyhow::Result<()> {
    let mut png = std::io::Cursor::new(Vec::new());
    grid(sweep, rows, picture).write_to(&mut png, image::ImageFormat::Png)?;
    super::results::write(&folder.join("grid.png"), png.into_inner())?;
    let maps: Vec<&Metric> =
        ["chamfer", "psnr", "last_bias", "last_variance"].into_iter().filter_map(metric).collect();
    super::results::write(&folder.join("heat.svg"), heat_map(sweep, rows, &maps))?;
    super::results::write(&folder.join("curves.svg"), curves(sweep, rows))?;
    super::results::write(&folder.join("pareto.svg"), pareto(sweep, rows))
}
