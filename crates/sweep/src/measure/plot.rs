//! Small log–log plots as SVG.

use std::fmt::Write;

/// A line of a panel.
#[derive(Debug)]
pub struct Curve {
    /// Its name in the legend.
    pub name: String,
    /// Points (x, y) with both coordinates above zero.
    pub points: Vec<(f64, f64)>,
}

/// A pair of axes.
#[derive(Debug)]
pub struct Panel {
    /// The title above it.
    pub title: String,
    /// Its curves.
    pub curves: Vec<Curve>,
    /// Whether to mark the Pareto front: the points that no other is below and left of.
    pub front: bool,
}

/// The Pareto front: the points of (cost, error) that no other beats in both, cheapest first.
///
/// `of` gives the cost and the error of a point.
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

/// Colours of the curves, in their order; they repeat after the last.
const COLORS: [&str; 10] = [
    "#999999", "#1f77b4", "#7fb2dd", "#9467bd", "#8c564b", "#bcbd22", "#17becf", "#d62728",
    "#2ca02c", "#000000",
];

/// Size of a panel in SVG units, with labels.
const WIDTH: f64 = 280.0;
const HEIGHT: f64 = 218.0;

/// Room for labels left of the axes and above them, in SVG units.
const LEFT: f64 = 52.0;
const TOP: f64 = 34.0;

/// Panels in a row.
const COLUMNS: usize = 3;

/// The corner of a panel with its legend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Corner {
    /// The upper right one.
    UpperRight,
    /// The lower left one.
    LowerLeft,
}

/// Draws panels in rows of three.
///
/// If all panels have curves of the same names in the same order, there is one legend below them;
/// otherwise each panel has its own, in its upper right corner.
pub fn svg(panels: &[Panel], x_label: &str, y_label: &str) -> String {
    svg_with_legends(panels, [x_label, y_label], Corner::UpperRight)
}

/// Like [`svg`], with the legends of single panels in another corner.
pub fn svg_with_legends(
    panels: &[Panel],
    [x_label, y_label]: [&str; 2],
    legends: Corner,
) -> String {
    let columns = COLUMNS.min(panels.len().max(1));
    let rows = panels.len().div_ceil(columns);
    let (width, height) =
        (columns as f64 * (WIDTH + 20.0) + 20.0, rows as f64 * (HEIGHT + 30.0) + 50.0);
    let mut out = open_svg(width, height);
    let names = |panel: &Panel| panel.curves.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
    let shared_legend = panels.windows(2).all(|pair| names(&pair[0]) == names(&pair[1]));
    for (i, panel) in panels.iter().enumerate() {
        let corner = (
            (i % columns) as f64 * (WIDTH + 20.0) + 10.0,
            (i / columns) as f64 * (HEIGHT + 30.0) + 10.0,
        );
        draw_panel(&mut out, panel, corner, x_label, y_label);
        if !shared_legend {
            let names = names(panel);
            let (x, y) = match legends {
                Corner::UpperRight => (corner.0 + WIDTH - 70.0, corner.1 + TOP + 8.0),
                Corner::LowerLeft => {
                    let below = 12.0 * names.len() as f64 + 10.0;
                    (corner.0 + LEFT + 8.0, corner.1 + HEIGHT - below)
                }
            };
            legend(&mut out, &names, |j| (x, y + 12.0 * j as f64));
        }
    }
    if let Some(panel) = panels.first().filter(|_| shared_legend) {
        legend(&mut out, &names(panel), |j| (20.0 + j as f64 * 95.0, height - 16.0));
    }
    out + "</svg>\n"
}

/// The start of an SVG file: its size and a white background. It ends with `</svg>`.
pub fn open_svg(width: f64, height: f64) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"10\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    )
}

/// The curves' names, each with a stroke in its colour at its place.
fn legend(out: &mut String, names: &[String], place: impl Fn(usize) -> (f64, f64)) {
    for (i, name) in names.iter().enumerate() {
        let (x, y) = place(i);
        let color = COLORS[i % COLORS.len()];
        let _ = writeln!(
            out,
            "<path d=\"M{x} {y}h18\" stroke=\"{color}\" stroke-width=\"2\"/>\
             <text x=\"{}\" y=\"{}\">{}</text>",
            x + 22.0,
            y + 3.0,
            escape(name)
        );
    }
}

/// Escapes `&` and `<` of text in SVG.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

/// Mark `i` of a logarithmic axis: one, two and five times the powers of ten, with mark 0 at 1.
fn mark(i: i32) -> f64 {
    [1.0, 2.0, 5.0][i.rem_euclid(3) as usize] * 10f64.powi(i.div_euclid(3))
}

/// The marks of an axis, from at most the least value to at least the largest. More than seven
/// marks are reduced to powers of ten.
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

/// The axes of a panel: marks and the rectangle between them, in SVG units.
struct Axes {
    marks_x: Vec<f64>,
    marks_y: Vec<f64>,
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Axes {
    /// The axes that hold all curves of a panel whose upper left corner is at `(x0, y0)`.
    fn new(panel: &Panel, (x0, y0): (f64, f64)) -> Self {
        let all = panel.curves.iter().flat_map(|c| c.points.iter());
        let marks_x = marks(all.clone().map(|p| p.0));
        let marks_y = marks(all.map(|p| p.1));
        let (left, top) = (x0 + LEFT, y0 + TOP);
        let (right, bottom) = (x0 + WIDTH, y0 + HEIGHT - 14.0);
        Axes { marks_x, marks_y, left, top, right, bottom }
    }

    /// The position of a value on an axis, from 0 at the first mark to 1 at the last.
    fn position(marks: &[f64], v: f64) -> f64 {
        let [from, to] = [marks[0].ln(), marks[marks.len() - 1].ln()];
        (v.ln() - from) / (to - from)
    }

    fn x(&self, v: f64) -> f64 {
        self.left + Self::position(&self.marks_x, v) * (self.right - self.left)
    }

    fn y(&self, v: f64) -> f64 {
        self.bottom - Self::position(&self.marks_y, v) * (self.bottom - self.top)
    }

    /// Points as the data of an SVG path, without the leading `M`.
    fn path(&self, points: &[(f64, f64)]) -> String {
        let points: Vec<String> =
            points.iter().map(|(a, b)| format!("{:.1} {:.1}", self.x(*a), self.y(*b))).collect();
        points.join("L")
    }

    /// Grid lines with the marks' numbers.
    fn draw_marks(&self, out: &mut String) {
        let Axes { left, top, right, bottom, .. } = self;
        for mark in &self.marks_x {
            let at = self.x(*mark);
            let _ = writeln!(
                out,
                "<path d=\"M{at} {top}V{bottom}\" stroke=\"#ddd\"/>\
                 <text x=\"{at}\" y=\"{}\" text-anchor=\"middle\">{mark:e}</text>",
                bottom + 12.0
            );
        }
        for mark in &self.marks_y {
            let at = self.y(*mark);
            let _ = writeln!(
                out,
                "<path d=\"M{left} {at}H{right}\" stroke=\"#ddd\"/>\
                 <text x=\"{}\" y=\"{}\" text-anchor=\"end\">{mark:e}</text>",
                left - 4.0,
                at + 3.0
            );
        }
    }

    /// The Pareto front of all curves, as a wide stroke below them.
    fn draw_front(&self, out: &mut String, panel: &Panel) {
        let all = panel.curves.iter().flat_map(|c| c.points.iter().copied()).collect();
        let path = self.path(&front(all, |p| *p));
        if !path.is_empty() {
            let _ = writeln!(
                out,
                "<path d=\"M{path}\" fill=\"none\" stroke=\"#ffd54f\" stroke-width=\"9\" \
                 stroke-linecap=\"round\" stroke-linejoin=\"round\"/>"
            );
        }
    }

    /// A curve with a dot at each point; nothing for a curve without points.
    fn draw_curve(&self, out: &mut String, curve: &Curve, color: &str) {
        let path = self.path(&curve.points);
        if path.is_empty() {
            return;
        }
        let _ = writeln!(
            out,
            "<path d=\"M{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>"
        );
        for (a, b) in &curve.points {
            let _ = writeln!(
                out,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2.5\" fill=\"{color}\"/>",
                self.x(*a),
                self.y(*b)
            );
        }
    }
}

/// Draws a panel with its upper left corner at `(x0, y0)`.
fn draw_panel(out: &mut String, panel: &Panel, (x0, y0): (f64, f64), x_label: &str, y_label: &str) {
    let axes = Axes::new(panel, (x0, y0));
    let _ = writeln!(
        out,
        "<text x=\"{}\" y=\"{}\" font-weight=\"bold\">{}</text>",
        axes.left,
        y0 + 10.0,
        escape(&panel.title)
    );
    axes.draw_marks(out);
    let _ = writeln!(
        out,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{x_label}</text>\
         <text x=\"{x0}\" y=\"{}\">{y_label}</text>",
        axes.right,
        axes.bottom + 24.0,
        y0 + 22.0
    );
    if panel.front {
        axes.draw_front(out, panel);
    }
    for (i, curve) in panel.curves.iter().enumerate() {
        axes.draw_curve(out, curve, COLORS[i % COLORS.len()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn front_has_the_points_that_no_other_beats() {
        let points = vec![(3.0, 0.3), (1.0, 1.0), (2.0, 1.1), (2.5, 0.2), (1.0, 2.0)];
        assert_eq!(front(points, |p| *p), [(1.0, 1.0), (2.5, 0.2)]);
    }

    #[test]
    fn marks_of_an_axis_enclose_its_values() {
        assert_eq!(marks([13.0, 35.0].into_iter()), [10.0, 20.0, 50.0]);
        assert_eq!(marks([1.0, 100.0].into_iter()), [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]);
        assert_eq!(marks([0.003, 70.0].into_iter()), [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0]);
        assert_eq!(marks([5.0].into_iter()), [5.0, 10.0]);
        assert_eq!(marks(std::iter::empty()).len(), 2);
    }
}
