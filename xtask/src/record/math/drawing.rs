//! Drawings as SVG text.

use std::fmt::Write;

use sweep::measure::plot::open_svg;

/// Colours of curves, in their order.
pub(super) const COLORS: [&str; 5] = ["#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e"];

/// A drawing in SVG units.
pub(super) struct Drawing {
    text: String,
}

/// The place of a text relative to its position.
#[derive(Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

impl Drawing {
    pub(super) fn new(width: f64, height: f64) -> Self {
        Drawing { text: open_svg(width, height) }
    }

    /// The file.
    pub(super) fn finish(self) -> String {
        self.text + "</svg>\n"
    }

    fn push(&mut self, element: std::fmt::Arguments<'_>) {
        let _ = writeln!(self.text, "{element}");
    }

    pub(super) fn rect(&mut self, [x, y]: [f64; 2], [w, h]: [f64; 2], style: &str) {
        self.push(format_args!(
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\" {style}/>"
        ));
    }

    pub(super) fn circle(&mut self, [x, y]: [f64; 2], r: f64, style: &str) {
        self.push(format_args!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r:.1}\" {style}/>"));
    }

    /// A polyline.
    pub(super) fn path(&mut self, points: &[[f64; 2]], style: &str) {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
        self.push(format_args!("<path d=\"M{}\" fill=\"none\" {style}/>", points.join("L")));
    }

    /// A filled polygon.
    pub(super) fn area(&mut self, points: &[[f64; 2]], style: &str) {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
        self.push(format_args!("<path d=\"M{}Z\" {style}/>", points.join("L")));
    }

    /// Filled squares of one size.
    pub(super) fn squares(&mut self, corners: &[[f64; 2]], side: f64, style: &str) {
        let square = |[x, y]: &[f64; 2]| format!("M{x} {y}h{side}v{side}h-{side}z");
        let path: String = corners.iter().map(square).collect();
        self.push(format_args!("<path d=\"{path}\" {style}/>"));
    }

    pub(super) fn line(&mut self, from: [f64; 2], to: [f64; 2], style: &str) {
        self.path(&[from, to], style);
    }

    /// An arrow whose head has the length `head`; nothing for a short one.
    pub(super) fn arrow(&mut self, from: [f64; 2], to: [f64; 2], head: f64, color: &str) {
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let length = dx.hypot(dy);
        if length < 1.0 {
            return;
        }
        let (x, y) = (dx / length * head, dy / length * head);
        let side = |s: f64| [to[0] - x - s * 0.5 * y, to[1] - y + s * 0.5 * x];
        self.line(from, to, &format!("stroke=\"{color}\" stroke-width=\"1.2\""));
        self.area(&[to, side(1.0), side(-1.0)], &format!("fill=\"{color}\""));
    }

    pub(super) fn text(&mut self, [x, y]: [f64; 2], anchor: Anchor, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        self.push(format_args!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>"
        ));
    }

    /// A bold title.
    pub(super) fn title(&mut self, [x, y]: [f64; 2], text: &str) {
        self.push(format_args!("<text x=\"{x}\" y=\"{y}\" font-weight=\"bold\">{text}</text>"));
    }

    /// Names of curves below each other, each with a stroke in its colour.
    pub(super) fn legend(&mut self, [x, y]: [f64; 2], names: &[String]) {
        for (i, (name, color)) in names.iter().zip(COLORS).enumerate() {
            let y = y + 13.0 * i as f64;
            self.line([x, y], [x + 16.0, y], &format!("stroke=\"{color}\" stroke-width=\"2\""));
            self.text([x + 20.0, y + 3.0], Anchor::Start, name);
        }
    }
}

/// Linear axes.
pub(super) struct Axes {
    /// The upper left corner and the size, in SVG units.
    pub(super) corner: [f64; 2],
    pub(super) size: [f64; 2],
    /// The ranges of both coordinates.
    pub(super) x: [f64; 2],
    pub(super) y: [f64; 2],
}

impl Axes {
    /// The position of a point.
    pub(super) fn at(&self, x: f64, y: f64) -> [f64; 2] {
        let part = |v: f64, [from, to]: [f64; 2]| (v - from) / (to - from);
        [
            self.corner[0] + part(x, self.x) * self.size[0],
            self.corner[1] + (1.0 - part(y, self.y)) * self.size[1],
        ]
    }

    /// Draws the frame with marks at these values.
    pub(super) fn draw(&self, out: &mut Drawing, marks_x: &[f64], marks_y: &[f64]) {
        for mark in marks_x {
            let ends = [self.at(*mark, self.y[0]), self.at(*mark, self.y[1])];
            out.line(ends[0], ends[1], "stroke=\"#ddd\"");
            out.text([ends[0][0], ends[0][1] + 12.0], Anchor::Middle, &number(*mark));
        }
        for mark in marks_y {
            let ends = [self.at(self.x[0], *mark), self.at(self.x[1], *mark)];
            out.line(ends[0], ends[1], "stroke=\"#ddd\"");
            out.text([ends[0][0] - 4.0, ends[0][1] + 3.0], Anchor::End, &number(*mark));
        }
        out.rect(self.corner, self.size, "fill=\"none\" stroke=\"#888\"");
    }

    /// Draws a curve, cut off at the frame.
    pub(super) fn curve(&self, out: &mut Drawing, points: &[[f64; 2]], style: &str) {
        let inside = |[_, y]: &[f64; 2]| (self.y[0]..=self.y[1]).contains(y);
        for part in points.chunk_by(|a, b| inside(a) == inside(b)).filter(|part| inside(&part[0])) {
            let points: Vec<[f64; 2]> = part.iter().map(|[x, y]| self.at(*x, *y)).collect();
            out.path(&points, style);
        }
    }

    /// The labels of both axes.
    pub(super) fn label(&self, out: &mut Drawing, x: &str, y: &str) {
        let [left, top] = self.corner;
        out.text([left + self.size[0], top + self.size[1] + 25.0], Anchor::End, x);
        out.text([left - 30.0, top - 7.0], Anchor::Start, y);
    }
}

/// A short form of a number.
fn number(value: f64) -> String {
    format!("{value}").replace('-', "−")
}
