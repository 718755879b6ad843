//! The opacity of a soft ball along rays.

use super::drawing::{Anchor, Axes, COLORS, Drawing};

/// The radius of the ball, in bounding radii.
const RADIUS: f64 = 0.5;

/// Distances of the rays from the centre, in bounding radii.
const AWAY: [f64; 3] = [0.2, 0.47, 0.53];

/// Sharpness of the curves, per bounding radius: at the start of a fit's soft part, at its
/// geometric middle, and at its end.
const SHARPNESS: [f64; 3] = [16.0, 56.6, 200.0];

/// Intervals of a curve.
const INTERVALS: usize = 200;

/// The drawing.
pub(super) fn draw() -> String {
    let mut out = Drawing::new(640.0, 470.0);
    draw_values(&mut out);
    for (i, away) in AWAY.into_iter().enumerate() {
        draw_opacity(&mut out, 45.0 + 200.0 * i as f64, away);
    }
    out.finish()
}

/// f at the distance t from the middle of a chord.
fn value(away: f64, t: f64) -> f64 {
    away.hypot(t) - RADIUS
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// The distances of the points of a chord from its middle.
fn distances(away: f64) -> impl Iterator<Item = f64> {
    let half = (1.0 - away * away).sqrt();
    (0..=INTERVALS).map(move |i| half * (2.0 * i as f64 / INTERVALS as f64 - 1.0))
}

fn draw_values(out: &mut Drawing) {
    out.title([20.0, 20.0], "f along three rays, in bounding radii");
    let axes = Axes { corner: [45.0, 40.0], size: [375.0, 150.0], x: [-1.0, 1.0], y: [-0.4, 0.6] };
    axes.draw(out, &[-1.0, -0.5, 0.0, 0.5, 1.0], &[-0.4, -0.2, 0.0, 0.2, 0.4, 0.6]);
    let dashes = ["", "stroke-dasharray=\"6 3\"", "stroke-dasharray=\"2 2\""];
    for (i, (away, dash)) in AWAY.into_iter().zip(dashes).enumerate() {
        let points: Vec<[f64; 2]> = distances(away).map(|t| [t, value(away, t)]).collect();
        axes.curve(out, &points, &format!("stroke=\"black\" stroke-width=\"1.5\" {dash}"));
        let y = 60.0 + 16.0 * i as f64;
        let style = format!("stroke=\"black\" stroke-width=\"1.5\" {dash}");
        out.line([440.0, y], [465.0, y], &style);
        let kind = if away < RADIUS { "hits" } else { "passes by" };
        out.text([470.0, y + 3.0], Anchor::Start, &format!("{away} from the centre: {kind}"));
    }
    out.text([440.0, 120.0], Anchor::Start, "a ball of radius 0.5, and");
    out.text([440.0, 134.0], Anchor::Start, "chords of the bounding sphere");
}

/// 1 − T along a ray, for each sharpness.
fn draw_opacity(out: &mut Drawing, left: f64, away: f64) {
    out.title([left - 25.0, 240.0], &format!("opacity 1 − T, ray at {away}"));
    let axes = Axes { corner: [left, 255.0], size: [155.0, 150.0], x: [-1.0, 1.0], y: [0.0, 1.0] };
    axes.draw(out, &[-1.0, 0.0, 1.0], &[0.0, 0.5, 1.0]);
    for (sharpness, color) in SHARPNESS.into_iter().zip(COLORS) {
        // A ray enters the sphere from outside the solid.
        let (mut before, mut transmittance) = (1.0, 1.0);
        let mut at = |t: f64| {
            let here = logistic(sharpness * value(away, t));
            transmittance *= f64::min(here / before, 1.0);
            before = here;
            [t, 1.0 - transmittance]
        };
        let points: Vec<[f64; 2]> = distances(away).map(&mut at).collect();
        axes.curve(out, &points, &format!("stroke=\"{color}\" stroke-width=\"1.5\""));
    }
    out.text([left + 155.0, 430.0], Anchor::End, "distance from the middle");
    if left < 100.0 {
        let names = SHARPNESS.map(|sharpness| format!("sharpness {sharpness}"));
        for (i, name) in names.iter().enumerate() {
            let (x, y) = (45.0 + 130.0 * i as f64, 452.0);
            let style = format!("stroke=\"{}\" stroke-width=\"2\"", COLORS[i]);
            out.line([x, y], [x + 16.0, y], &style);
            out.text([x + 20.0, y + 3.0], Anchor::Start, name);
        }
    }
}
