//! Small log–log plots as SVG.

use std::fmt::Write;

/// A line of a panel.
pub(crate) struct Curve {
    pub(crate) name: String,
    /// Points above zero.
    pub(crate) points: Vec<(f64, f64)>,
}

/// A pair of axes.
pub(crate) struct Panel {
    pub(crate) title: String,
    pub(crate) curves: Vec<Curve>,
}

const COLORS: [&str; 10] =
    ["#999999", "#1f77b4", "#7fb2dd", "#9467bd", "#8c564b", "#bcbd22", "#17becf", "#d62728", "#2ca02c", "#000000"];
const WIDTH: f64 = 280.0;
const HEIGHT: f64 = 210.0;
const LEFT: f64 = 52.0;
const TOP: f64 = 26.0;
const COLUMNS: usize = 3;

/// Panels in rows. Where all have the curves' names in the same order there is one legend, else one in each panel.
pub(crate) fn svg(panels: &[Panel], x_label: &str, y_label: &str) -> String {
    let columns = COLUMNS.min(panels.len().max(1));
    let rows = panels.len().div_ceil(columns);
    let (width, height) = (columns as f64 * (WIDTH + 20.0) + 20.0, rows as f64 * (HEIGHT + 30.0) + 50.0);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"10\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    let names = |panel: &Panel| panel.curves.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
    let alike = panels.windows(2).all(|pair| names(&pair[0]) == names(&pair[1]));
    for (i, panel) in panels.iter().enumerate() {
        let corner = ((i % columns) as f64 * (WIDTH + 20.0) + 10.0, (i / columns) as f64 * (HEIGHT + 30.0) + 10.0);
        draw(&mut out, panel, corner, x_label, y_label);
        if !alike {
            let place = |j: usize| (corner.0 + WIDTH - 70.0, corner.1 + TOP + 8.0 + 12.0 * j as f64);
            legend(&mut out, &names(panel), place);
        }
    }
    if let Some(panel) = panels.first().filter(|_| alike) {
        legend(&mut out, &names(panel), |j| (20.0 + j as f64 * 95.0, height - 16.0));
    }
    out + "</svg>\n"
}

/// The curves' names, each at its place.
fn legend(out: &mut String, names: &[String], place: impl Fn(usize) -> (f64, f64)) {
    for (i, name) in names.iter().enumerate() {
        let (x, y) = place(i);
        let color = COLORS[i % COLORS.len()];
        let _ = writeln!(
            out,
            "<path d=\"M{x} {y}h18\" stroke=\"{color}\" stroke-width=\"2\"/><text x=\"{}\" y=\"{}\">{name}</text>",
            x + 22.0,
            y + 3.0
        );
    }
}

/// The powers of ten that hold all values, as exponents.
fn decades(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let (low, high) = (values.clone().fold(f64::MAX, f64::min), values.fold(f64::MIN_POSITIVE, f64::max));
    let (from, to) = (low.min(high).log10().floor(), high.log10().ceil());
    (from, to.max(from + 1.0))
}

fn draw(out: &mut String, panel: &Panel, (x0, y0): (f64, f64), x_label: &str, y_label: &str) {
    let all = panel.curves.iter().flat_map(|c| c.points.iter());
    let (from_x, to_x) = decades(all.clone().map(|p| p.0));
    let (from_y, to_y) = decades(all.map(|p| p.1));
    let (left, top, right, bottom) = (x0 + LEFT, y0 + TOP, x0 + WIDTH, y0 + HEIGHT - 14.0);
    let x = |v: f64| left + (v.log10() - from_x) / (to_x - from_x) * (right - left);
    let y = |v: f64| bottom - (v.log10() - from_y) / (to_y - from_y) * (bottom - top);
    let _ = writeln!(out, "<text x=\"{left}\" y=\"{}\" font-weight=\"bold\">{}</text>", y0 + 14.0, panel.title);
    for decade in from_x as i32..=to_x as i32 {
        let at = x(10f64.powi(decade));
        let _ = writeln!(
            out,
            "<path d=\"M{at} {top}V{bottom}\" stroke=\"#ddd\"/><text x=\"{at}\" y=\"{}\" text-anchor=\"middle\">1e{decade}</text>",
            bottom + 12.0
        );
    }
    for decade in from_y as i32..=to_y as i32 {
        let at = y(10f64.powi(decade));
        let _ = writeln!(
            out,
            "<path d=\"M{left} {at}H{right}\" stroke=\"#ddd\"/><text x=\"{}\" y=\"{}\" text-anchor=\"end\">1e{decade}</text>",
            left - 4.0,
            at + 3.0
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{right}\" y=\"{}\" text-anchor=\"end\">{x_label}</text><text x=\"{left}\" y=\"{}\" text-anchor=\"end\">{y_label}</text>",
        bottom + 24.0,
        top - 4.0
    );
    for (i, curve) in panel.curves.iter().enumerate() {
        let color = COLORS[i % COLORS.len()];
        let path: Vec<String> = curve.points.iter().map(|(a, b)| format!("{:.1} {:.1}", x(*a), y(*b))).collect();
        if path.is_empty() {
            continue;
        }
        let _ = writeln!(out, "<path d=\"M{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>", path.join("L"));
        for (a, b) in &curve.points {
            let _ = writeln!(out, "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2.5\" fill=\"{color}\"/>", x(*a), y(*b));
        }
    }
}
