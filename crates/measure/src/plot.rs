//! Small log–log plots as SVG.

use std::fmt::Write;

/// A line of a panel.
pub struct Curve {
    /// Its name in the legend.
    pub name: String,
    /// Points above zero.
    pub points: Vec<(f64, f64)>,
}

/// A pair of axes.
pub struct Panel {
    /// The title above it.
    pub title: String,
    /// Its curves.
    pub curves: Vec<Curve>,
    /// Whether to mark the points that no other is below and left of.
    pub front: bool,
}

/// The points of (cost, error) that no other beats in both, cheapest first.
pub fn front<T>(mut points: Vec<T>, of: impl Fn(&T) -> (f64, f64)) -> Vec<T> {
    points.sort_by(|a, b| of(a).partial_cmp(&of(b)).unwrap_or(std::cmp::Ordering::Equal));
    let mut least = f64::INFINITY;
    points.retain(|point| {
        let (_, error) = of(point);
        let better = error < least;
        least = least.min(error);
        better
    });
    points
}

const COLORS: [&str; 10] = [
    "#999999", "#1f77b4", "#7fb2dd", "#9467bd", "#8c564b", "#bcbd22", "#17becf", "#d62728",
    "#2ca02c", "#000000",
];
const WIDTH: f64 = 280.0;
const HEIGHT: f64 = 218.0;
const LEFT: f64 = 52.0;
const TOP: f64 = 34.0;
const COLUMNS: usize = 3;

/// Panels in rows. Where all have the curves' names in the same order there is one legend, else one
/// in each panel.
pub fn svg(panels: &[Panel], x_label: &str, y_label: &str) -> String {
    let columns = COLUMNS.min(panels.len().max(1));
    let rows = panels.len().div_ceil(columns);
    let (width, height) =
        (columns as f64 * (WIDTH + 20.0) + 20.0, rows as f64 * (HEIGHT + 30.0) + 50.0);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"10\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    let names = |panel: &Panel| panel.curves.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
    let alike = panels.windows(2).all(|pair| names(&pair[0]) == names(&pair[1]));
    for (i, panel) in panels.iter().enumerate() {
        let corner = (
            (i % columns) as f64 * (WIDTH + 20.0) + 10.0,
            (i / columns) as f64 * (HEIGHT + 30.0) + 10.0,
        );
        draw(&mut out, panel, corner, x_label, y_label);
        if !alike {
            let place =
                |j: usize| (corner.0 + WIDTH - 70.0, corner.1 + TOP + 8.0 + 12.0 * j as f64);
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
            "<path d=\"M{x} {y}h18\" stroke=\"{color}\" stroke-width=\"2\"/><text x=\"{}\" y=\"{}\">{}</text>",
            x + 22.0,
            y + 3.0,
            escape(name)
        );
    }
}

/// Text in SVG.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

/// One, two and five times the powers of ten.
fn mark(i: i32) -> f64 {
    [1.0, 2.0, 5.0][i.rem_euclid(3) as usize] * 10f64.powi(i.div_euclid(3))
}

/// The marks of an axis that holds all values; where they are many, powers of ten alone.
fn marks(values: impl Iterator<Item = f64> + Clone) -> Vec<f64> {
    let (low, high) =
        (values.clone().fold(f64::MAX, f64::min), values.fold(f64::MIN_POSITIVE, f64::max));
    let low = low.min(high);
    let start = 3 * low.log10().floor() as i32;
    let from = (start..).take_while(|&i| mark(i) <= low).last().unwrap_or(start);
    let to = (from + 1..).find(|&i| mark(i) >= high).unwrap_or(from + 1);
    if to - from <= 6 {
        return (from..=to).map(mark).collect();
    }
    (from.div_euclid(3)..=(to + 2).div_euclid(3)).map(|i| mark(3 * i)).collect()
}

fn draw(out: &mut String, panel: &Panel, (x0, y0): (f64, f64), x_label: &str, y_label: &str) {
    let all = panel.curves.iter().flat_map(|c| c.points.iter());
    let marks_x = marks(all.clone().map(|p| p.0));
    let marks_y = marks(all.map(|p| p.1));
    // Where a value is on an axis, from 0 to 1.
    let place = |marks: &[f64], v: f64| {
        let [from, to] = [marks[0].ln(), marks[marks.len() - 1].ln()];
        (v.ln() - from) / (to - from)
    };
    let (left, top, right, bottom) = (x0 + LEFT, y0 + TOP, x0 + WIDTH, y0 + HEIGHT - 14.0);
    let x = |v: f64| left + place(&marks_x, v) * (right - left);
    let y = |v: f64| bottom - place(&marks_y, v) * (bottom - top);
    let _ = writeln!(
        out,
        "<text x=\"{left}\" y=\"{}\" font-weight=\"bold\">{}</text>",
        y0 + 10.0,
        escape(&panel.title)
    );
    for mark in &marks_x {
        let at = x(*mark);
        let _ = writeln!(
            out,
            "<path d=\"M{at} {top}V{bottom}\" stroke=\"#ddd\"/><text x=\"{at}\" y=\"{}\" text-anchor=\"middle\">{mark:e}</text>",
            bottom + 12.0
        );
    }
    for mark in &marks_y {
        let at = y(*mark);
        let _ = writeln!(
            out,
            "<path d=\"M{left} {at}H{right}\" stroke=\"#ddd\"/><text x=\"{}\" y=\"{}\" text-anchor=\"end\">{mark:e}</text>",
            left - 4.0,
            at + 3.0
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{right}\" y=\"{}\" text-anchor=\"end\">{x_label}</text><text x=\"{x0}\" y=\"{}\">{y_label}</text>",
        bottom + 24.0,
        y0 + 22.0
    );
    if panel.front {
        let all = panel.curves.iter().flat_map(|c| c.points.iter().copied()).collect();
        let corners: Vec<String> =
            front(all, |p| *p).iter().map(|(a, b)| format!("{:.1} {:.1}", x(*a), y(*b))).collect();
        if !corners.is_empty() {
            let path = corners.join("L");
            let _ = writeln!(
                out,
                "<path d=\"M{path}\" fill=\"none\" stroke=\"#ffd54f\" stroke-width=\"9\" stroke-linecap=\"round\" stroke-linejoin=\"round\"/>"
            );
        }
    }
    for (i, curve) in panel.curves.iter().enumerate() {
        let color = COLORS[i % COLORS.len()];
        let path: Vec<String> =
            curve.points.iter().map(|(a, b)| format!("{:.1} {:.1}", x(*a), y(*b))).collect();
        if path.is_empty() {
            continue;
        }
        let _ = writeln!(
            out,
            "<path d=\"M{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>",
            path.join("L")
        );
        for (a, b) in &curve.points {
            let _ = writeln!(
                out,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2.5\" fill=\"{color}\"/>",
                x(*a),
                y(*b)
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_beats() {
        let points = vec![(3.0, 0.3), (1.0, 1.0), (2.0, 1.1), (2.5, 0.2), (1.0, 2.0)];
        assert_eq!(front(points, |p| *p), [(1.0, 1.0), (2.5, 0.2)]);
    }

    #[test]
    fn the_marks_of_an_axis_hold_its_values() {
        assert_eq!(marks([13.0, 35.0].into_iter()), [10.0, 20.0, 50.0]);
        assert_eq!(marks([1.0, 100.0].into_iter()), [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]);
        assert_eq!(marks([0.003, 70.0].into_iter()), [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0]);
        assert_eq!(marks([5.0].into_iter()), [5.0, 10.0]);
        assert_eq!(marks(std::iter::empty()).len(), 2);
    }
}
