//! The disc: derivative of its pixels by its radius, and sampled areas, whose derivative is zero.

use std::f64::consts::{PI, TAU};

use super::ball::{BALL, Ball, Film, Parameter};
use super::drawing::{Anchor, Axes, Drawing};

/// Pixels along a side of the film.
pub(super) const SIDE: usize = 16;

/// Pieces of the outline in the closed form of the derivative image.
const PIECES: usize = 1 << 18;

/// The exact derivative of all pixels by a parameter, for a ball of radiance 1 in front of black:
/// ∮ v dl over the part of the outline in each pixel.
pub(super) fn derivative(parameter: Parameter) -> Vec<f64> {
    let (mut sum, radius) = (vec![0.0; SIDE * SIDE], BALL.outline());
    for i in 0..PIECES {
        let angle = TAU * (i as f64 + 0.5) / PIECES as f64;
        let n = [angle.cos(), angle.sin()];
        let [x, y] = n.map(|v| (BALL.principal + radius * v) as usize);
        sum[y * SIDE + x] += BALL.velocity(parameter, n) * radius * TAU / PIECES as f64;
    }
    sum
}

/// The share of the samples of a fixed grid, `count` along a side of a pixel, that hit the ball,
/// in square pixels.
fn sampled_area(ball: &Ball, count: usize) -> f64 {
    let n = SIDE * count;
    let at = |i: usize| (i as f64 + 0.5) / count as f64;
    let hit = |u: Film| ball.closest(u).0 < 0.0;
    let hits = (0..n * n).filter(|i| hit([at(i % n), at(i / n)])).count();
    hits as f64 / (count * count) as f64
}

/// The drawing.
pub(super) fn draw() -> String {
    let mut out = Drawing::new(640.0, 300.0);
    draw_film(&mut out);
    draw_areas(&mut out);
    out.finish()
}

/// The film with the outline, and the derivative of each pixel by the radius as a shade.
fn draw_film(out: &mut Drawing) {
    out.title([20.0, 20.0], "dI/dr of each pixel: only the border moves");
    let (first, count) = (2, 12);
    let axes = Axes {
        corner: [20.0, 35.0],
        size: [240.0; 2],
        x: [first as f64, (first + count) as f64],
        // y points down.
        y: [(first + count) as f64, first as f64],
    };
    let derivative = derivative(Parameter::Radius);
    let largest = derivative.iter().copied().fold(0.0, f64::max);
    for (x, y) in (0..count).flat_map(|y| (0..count).map(move |x| (x + first, y + first))) {
        let share = derivative[y * SIDE + x] / largest;
        let [red, others] = [255.0 - 25.0 * share, 255.0 - 175.0 * share].map(|v| v as u8);
        let style = format!("fill=\"rgb({red},{others},{others})\" stroke=\"#ccc\"");
        out.rect(axes.at(x as f64, y as f64), [20.0; 2], &style);
    }
    let moved = Ball { radius: BALL.radius + 0.05, ..BALL };
    for (ball, dash) in [(BALL, ""), (moved, "stroke-dasharray=\"4 3\"")] {
        let style = format!("fill=\"none\" stroke=\"black\" stroke-width=\"1.5\" {dash}");
        out.circle(axes.at(BALL.principal, BALL.principal), ball.outline() * 20.0, &style);
    }
    let angle = -0.7f64;
    let n = [angle.cos(), angle.sin()];
    let [from, to] = [0.0, 1.4].map(|away| n.map(|v| BALL.principal + (BALL.outline() + away) * v));
    out.arrow(axes.at(from[0], from[1]), axes.at(to[0], to[1]), 7.0, "#1f77b4");
    out.text(axes.at(to[0] + 0.2, to[1]), Anchor::Start, "normal velocity v");
    out.text([20.0, 292.0], Anchor::Start, "solid: outline at r = 0.7; dashed: at r = 0.75");
}

/// Area against radius: exact, its tangent, and with fixed samples.
fn draw_areas(out: &mut Drawing) {
    out.title([330.0, 20.0], "area of the disc, with fixed samples");
    let axes = Axes { corner: [350.0, 45.0], size: [270.0, 220.0], x: [0.6, 0.8], y: [40.0, 80.0] };
    axes.draw(out, &[0.6, 0.65, 0.7, 0.75, 0.8], &[40.0, 50.0, 60.0, 70.0, 80.0]);
    axes.label(out, "radius r", "square pixels");
    let radii = |count: usize| (0..=count).map(move |i| 0.6 + 0.2 * i as f64 / count as f64);
    let ball = |radius| Ball { radius, ..BALL };
    let exact = |r: f64| PI * ball(r).outline().powi(2);
    let steps: Vec<[f64; 2]> = radii(800).map(|r| [r, sampled_area(&ball(r), 1)]).collect();
    let steps: Vec<[f64; 2]> = steps
        .chunk_by(|a, b| a[1] == b[1])
        .flat_map(|part| [part[0], part[part.len() - 1]])
        .collect();
    axes.curve(out, &steps, "stroke=\"#d62728\" stroke-width=\"1.5\"");
    let smooth: Vec<[f64; 2]> = radii(60).map(|r| [r, exact(r)]).collect();
    axes.curve(out, &smooth, "stroke=\"#1f77b4\" stroke-width=\"2\"");
    let slope = TAU * BALL.outline() * BALL.velocity(Parameter::Radius, [1.0, 0.0]);
    let tangent = |r: f64| [r, exact(0.7) + slope * (r - 0.7)];
    axes.curve(out, &[tangent(0.64), tangent(0.76)], "stroke=\"black\" stroke-dasharray=\"5 3\"");
    let names = ["exact area".to_owned(), "one fixed sample a pixel: slope 0".to_owned()];
    out.legend([360.0, 58.0], &names);
    out.text([380.0, 87.0], Anchor::Start, &format!("dashed: tangent at 0.7, slope {slope:.1}"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_derivative_image_sums_to_the_derivative_of_the_area() {
        // 2π F² r D²/(D² − r²)².
        let exact = TAU * 576.0 * 0.7 * 16.0 / (16.0f64 - 0.49).powi(2);
        let sum: f64 = derivative(Parameter::Radius).iter().sum();
        assert!((sum / exact - 1.0).abs() < 1e-9);
        // A disc that moves to the right gains on the right and loses on the left.
        assert!(derivative(Parameter::Center(0)).iter().sum::<f64>().abs() < 1e-9);
    }
}
