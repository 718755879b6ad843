//! The warp around one pixel: the flux through its border, and the Gaussian filter in its place.

use super::ball::{BALL, Film, Parameter, SETTINGS};
use super::drawing::{Anchor, Axes, Drawing};

/// The upper left corner of the pixel.
const PIXEL: Film = [11.0, 10.0];

/// The standard deviation of the Gaussian filter, in pixels.
const DEVIATION: f64 = 0.5;

/// The drawing.
pub(super) fn draw() -> String {
    let mut out = Drawing::new(640.0, 350.0);
    let axes = |left: f64| Axes {
        corner: [left, 35.0],
        size: [280.0; 2],
        x: [PIXEL[0] - 0.75, PIXEL[0] + 1.75],
        y: [PIXEL[1] + 1.75, PIXEL[1] - 0.75],
    };
    draw_box(&mut out, &axes(20.0));
    draw_gaussian(&mut out, &axes(340.0));
    out.finish()
}

/// The disc, the borders of the pixels around, and the outline.
fn draw_film(out: &mut Drawing, axes: &Axes) {
    let [left, top] = axes.corner;
    out.rect([left, top], axes.size, "fill=\"white\" stroke=\"#888\"");
    let on = |angle: f64| {
        axes.at(
            BALL.principal + BALL.outline() * angle.cos(),
            BALL.principal + BALL.outline() * angle.sin(),
        )
    };
    let inside = |p: &[f64; 2]| {
        (0..2).all(|e| p[e] >= axes.corner[e] && p[e] <= axes.corner[e] + axes.size[e])
    };
    let arc: Vec<[f64; 2]> = (0..=800).map(|i| on(f64::from(i) * 0.002)).filter(inside).collect();
    let mut disc = arc.clone();
    disc.extend([[left, top + axes.size[1]], [left, top]]);
    out.area(&disc, "fill=\"#e3e9f2\"");
    for i in 0..2 {
        let (x, y) = (PIXEL[0] + f64::from(i), PIXEL[1] + f64::from(i));
        out.line(axes.at(x, axes.y[0]), axes.at(x, axes.y[1]), "stroke=\"#bbb\"");
        out.line(axes.at(axes.x[0], y), axes.at(axes.x[1], y), "stroke=\"#bbb\"");
    }
    out.path(&arc, "stroke=\"black\" stroke-width=\"1.5\"");
}

fn warp(u: Film) -> Film {
    BALL.warp(u, Parameter::Radius, &SETTINGS)
}

/// V, and its flux through the border of the pixel where the radiance is not zero.
fn draw_box(out: &mut Drawing, axes: &Axes) {
    out.title([20.0, 20.0], "box filter: V, and its flux through the border");
    draw_film(out, axes);
    for (i, j) in (0..8).flat_map(|j| (0..8).map(move |i| (i, j))) {
        let u = [i, j].map(|v| f64::from(v) * 0.31 + 0.16);
        let u = [axes.x[0] + u[0], axes.y[1] + u[1]];
        let v = warp(u);
        out.arrow(
            axes.at(u[0], u[1]),
            axes.at(u[0] + 0.03 * v[0], u[1] + 0.03 * v[1]),
            4.0,
            "#8aa",
        );
    }
    let corner = axes.at(PIXEL[0], PIXEL[1]);
    out.rect(corner, [112.0; 2], "fill=\"none\" stroke=\"#333\" stroke-width=\"2.5\"");
    for (axis, side) in [(0, 0.0), (0, 1.0), (1, 0.0), (1, 1.0)] {
        for along in [0.1, 0.3, 0.5, 0.7, 0.9] {
            let mut u = PIXEL;
            u[axis] += side;
            u[1 - axis] += along;
            let flux = warp(u)[axis] * 0.05;
            if BALL.closest(u).0 < 0.0 {
                let mut to = u;
                to[axis] += flux;
                out.arrow(axes.at(u[0], u[1]), axes.at(to[0], to[1]), 6.0, "#2ca02c");
            }
        }
    }
    out.text(
        [20.0, 330.0],
        Anchor::Start,
        "green: V carries radiance of the disc through the border;",
    );
    out.text([20.0, 343.0], Anchor::Start, "this flux is subtracted. The background is black.");
}

/// The filter's standard deviations, and the gradient of its logarithm.
fn draw_gaussian(out: &mut Drawing, axes: &Axes) {
    out.title([340.0, 20.0], "Gaussian filter: ∇ ln κ, in place of the border");
    draw_film(out, axes);
    let middle = PIXEL.map(|v| v + 0.5);
    for k in 1..=2 {
        let radius = f64::from(k) * DEVIATION * 112.0;
        out.circle(axes.at(middle[0], middle[1]), radius, "fill=\"none\" stroke=\"#9467bd\"");
    }
    for (i, j) in (0..8).flat_map(|j| (0..8).map(move |i| (i, j))) {
        let u = [axes.x[0] + 0.16 + f64::from(i) * 0.31, axes.y[1] + 0.16 + f64::from(j) * 0.31];
        let rate = [0, 1].map(|e| -(u[e] - middle[e]) / (DEVIATION * DEVIATION) * 0.05);
        out.arrow(axes.at(u[0], u[1]), axes.at(u[0] + rate[0], u[1] + rate[1]), 4.0, "#9467bd");
    }
    out.text([340.0, 330.0], Anchor::Start, "circles: 1 and 2 standard deviations of 0.5 pixels;");
    out.text([340.0, 343.0], Anchor::Start, "the arrows do not vanish inside the disc");
}
