//! Lines across a pixel: crossings with the silhouette, samples of the smooth part, and the search
//! for a crossing.

use super::ball::{BALL, Film};
use super::drawing::{Anchor, Axes, COLORS, Drawing};

/// The upper left corner of the pixel.
const PIXEL: Film = [11.0, 10.0];

/// The positions of the lines across their axis, and of their samples in the strata.
const LINES: [[f64; 2]; 4] = [[0.09, 0.7], [0.33, 0.2], [0.62, 0.45], [0.87, 0.9]];

/// Samples of the smooth part per pixel of length.
const PER_PIXEL: f64 = 2.0;

/// The drawing.
pub(super) fn draw() -> String {
    let mut out = Drawing::new(640.0, 330.0);
    draw_pixel(&mut out);
    draw_search(&mut out);
    out.finish()
}

/// The s at which a line along `axis`, at `across` on the other axis, meets the outline.
fn crossing(axis: usize, across: f64) -> Option<f64> {
    let away = PIXEL[1 - axis] + across - BALL.principal;
    let square = BALL.outline().powi(2) - away * away;
    let s = BALL.principal + square.sqrt() - PIXEL[axis];
    (0.0..1.0).contains(&s).then_some(s)
}

/// The place of a sample in a segment of length 1 whose ends are dense or not.
fn placed(w: f64, dense: [bool; 2]) -> f64 {
    match dense {
        [false, false] => w,
        [true, false] => w * w,
        [false, true] => 1.0 - (1.0 - w) * (1.0 - w),
        [true, true] => w * w * (3.0 - 2.0 * w),
    }
}

/// A pixel with its lines.
fn draw_pixel(out: &mut Drawing) {
    out.title([20.0, 20.0], "four lines along each axis of a pixel");
    let axes = Axes {
        corner: [20.0, 35.0],
        size: [250.0; 2],
        x: [PIXEL[0], PIXEL[0] + 1.0],
        y: [PIXEL[1] + 1.0, PIXEL[1]],
    };
    // From the upper end of the outline in the pixel to its lower end.
    let angle = |s: f64, across: f64| {
        let [x, y] = [s, across].map(|v| v - BALL.principal);
        y.atan2(x)
    };
    let [from, to] = [0.0, 1.0].map(|across| {
        let s = crossing(0, across).unwrap_or(0.0);
        angle(PIXEL[0] + s, PIXEL[1] + across)
    });
    let on = |i: usize| {
        let a = from + (to - from) * i as f64 / 60.0;
        let r = BALL.outline();
        axes.at(BALL.principal + r * a.cos(), BALL.principal + r * a.sin())
    };
    let arc: Vec<[f64; 2]> = (0..=60).map(on).collect();
    let mut disc = arc.clone();
    disc.extend([axes.at(PIXEL[0], PIXEL[1] + 1.0), axes.at(PIXEL[0], PIXEL[1])]);
    out.area(&disc, "fill=\"#e3e9f2\"");
    out.path(&arc, "stroke=\"black\" stroke-width=\"1.5\"");
    for (axis, line) in (0..2).flat_map(|axis| LINES.map(|line| (axis, line))) {
        draw_line(out, &axes, axis, line);
    }
    out.rect(axes.corner, axes.size, "fill=\"none\" stroke=\"#333\" stroke-width=\"2\"");
    out.text(
        [20.0, 303.0],
        Anchor::Start,
        "discs: crossings, area ∝ |n| along the line; bars: samples",
    );
    out.text([20.0, 316.0], Anchor::Start, "of the smooth part, denser inside the outline");
}

/// One line: its crossing, and the samples on its segments.
fn draw_line(out: &mut Drawing, axes: &Axes, axis: usize, [across, offset]: [f64; 2]) {
    let at = |s: f64| {
        let mut u = PIXEL;
        u[axis] += s;
        u[1 - axis] += across;
        u
    };
    let color = COLORS[2 * axis];
    let [from, to] = [0.0, 1.0].map(|s| axes.at(at(s)[0], at(s)[1]));
    out.line(from, to, &format!("stroke=\"{color}\" stroke-width=\"0.8\""));
    let found = crossing(axis, across);
    let mut segments = vec![([0.0, found.unwrap_or(1.0)], [false, found.is_some()])];
    segments.extend(found.map(|s| ([s, 1.0], [false, false])));
    for ([from, to], dense) in segments {
        let count = ((to - from) * PER_PIXEL).ceil().max(1.0);
        for j in 0..count as usize {
            let s = from + (to - from) * placed((j as f64 + offset) / count, dense);
            let [x, y] = axes.at(at(s)[0], at(s)[1]);
            let side = if axis == 0 { [0.0, 4.0] } else { [4.0, 0.0] };
            let ends = [[x - side[0], y - side[1]], [x + side[0], y + side[1]]];
            out.line(ends[0], ends[1], &format!("stroke=\"{color}\" stroke-width=\"2\""));
        }
    }
    if let Some(s) = found {
        let u = at(s);
        let n = (u[axis] - BALL.principal) / BALL.outline();
        out.circle(axes.at(u[0], u[1]), 6.0 * n.abs().sqrt(), &format!("fill=\"{color}\""));
    }
}

/// f along the rays of a search, from a probe at the right end of a line.
fn draw_search(out: &mut Drawing) {
    out.title([330.0, 20.0], "Newton's method on m(s) = min f");
    let axes =
        Axes { corner: [365.0, 45.0], size: [250.0, 230.0], x: [3.4, 4.4], y: [-0.02, 0.24] };
    axes.draw(out, &[3.4, 3.6, 3.8, 4.0, 4.2, 4.4], &[0.0, 0.05, 0.1, 0.15, 0.2]);
    axes.label(out, "distance t along the ray", "f, world units");
    let at = |s: f64| [PIXEL[0] + s, PIXEL[1] + LINES[1][0]];
    let m = |s: f64| BALL.closest(at(s)).0;
    let mut s = 1.0;
    let mut names = Vec::new();
    for color in &COLORS[..2] {
        let curve = |i: i32| {
            let t = 3.4 + f64::from(i) / 80.0;
            [t, BALL.value(at(s), t)]
        };
        let points: Vec<[f64; 2]> = (0..=80).map(curve).collect();
        axes.curve(out, &points, &format!("stroke=\"{color}\" stroke-width=\"1.5\""));
        let (lowest, t) = BALL.closest(at(s));
        out.circle(axes.at(t, lowest), 3.5, &format!("fill=\"{color}\""));
        names.push(format!("s = {s:.4}, m = {lowest:.5}"));
        let slope = (m(s + 1e-6) - m(s - 1e-6)) / 2e-6;
        s -= lowest / slope;
    }
    out.legend([425.0, 60.0], &names);
    let exact = crossing(0, LINES[1][0]).unwrap_or(f64::NAN);
    out.text([425.0, 92.0], Anchor::Start, &format!("crossing of the outline: s = {exact:.4}"));
}
