//! The points of sphere tracing beside a silhouette, and their weights.

use super::ball::{BALL, SETTINGS, Visit, length};
use super::drawing::{Anchor, Axes, Drawing};

/// Distances of the rays outside the outline, in pixels.
const AWAY: [f64; 3] = [1.0, 0.1, 0.001];

/// The drawing.
pub(super) fn draw() -> String {
    let mut out = Drawing::new(640.0, 590.0);
    draw_points(&mut out);
    for (i, away) in AWAY.into_iter().enumerate() {
        draw_weights(&mut out, 268.0 + 105.0 * i as f64, away);
    }
    out.text([620.0, 580.0], Anchor::End, "distance t along the ray");
    out.finish()
}

fn visits(away: f64) -> Vec<Visit> {
    BALL.visits([BALL.principal + BALL.outline() + away, BALL.principal], &SETTINGS)
}

/// The section of the ball with the points of the middle ray.
fn draw_points(out: &mut Drawing) {
    out.title([20.0, 20.0], "22 points of sphere tracing, 0.1 pixels outside the outline");
    // The eye is on the left: −z points to the right.
    let scale = 100.0;
    let at = |z: f64, x: f64| [240.0 - z * scale, 130.0 - x * scale];
    out.circle(at(0.0, 0.0), BALL.radius * scale, "fill=\"#e8eef5\" stroke=\"#456\"");
    out.circle(
        at(0.0, 0.0),
        BALL.bounds * scale,
        "fill=\"none\" stroke=\"#999\" stroke-dasharray=\"4 3\"",
    );
    out.text(at(0.12, -0.05), Anchor::Start, "f &lt; 0");
    out.text(at(-0.85, -0.85), Anchor::Start, "bounding sphere");
    let visits = visits(AWAY[1]);
    let ends = [&visits[0].x, &visits[visits.len() - 1].x].map(|x| at(x[2], x[0]));
    out.line([ends[0][0] - 40.0, ends[0][1] + 6.9], ends[1], "stroke=\"#888\"");
    out.text([ends[0][0] - 42.0, ends[0][1] + 20.0], Anchor::Middle, "from the eye");
    for visit in &visits {
        let gap = (length(visit.x) - BALL.radius) * scale;
        let place = at(visit.x[2], visit.x[0]);
        out.circle(place, gap, "fill=\"none\" stroke=\"#ccc\" stroke-width=\"0.7\"");
    }
    for visit in &visits {
        let fill = if visit.weight > 0.0 { "#d62728" } else { "white" };
        let style = format!("fill=\"{fill}\" stroke=\"#d62728\"");
        out.circle(at(visit.x[2], visit.x[0]), 2.5, &style);
    }
    let lines = [
        "grey circles: empty balls of radius f;",
        "each step goes to the end of its ball",
        "filled: keeps a weight (k = 14)",
        "open: no weight",
        "",
        "below: the same for three rays;",
        "blue: the distance of the tangent",
    ];
    for (i, line) in lines.iter().enumerate() {
        out.text([420.0, 60.0 + 14.0 * i as f64], Anchor::Start, line);
    }
}

/// The weights of a ray as stems along it.
fn draw_weights(out: &mut Drawing, top: f64, away: f64) {
    let visits = visits(away);
    let axes = Axes { corner: [60.0, top], size: [560.0, 65.0], x: [3.0, 4.8], y: [0.0, 0.6] };
    axes.draw(out, &[3.0, 3.5, 4.0, 4.5], &[0.0, 0.3, 0.6]);
    let largest = visits.iter().map(|v| v.weight).fold(0.0, f64::max);
    out.title([60.0, top - 5.0], &format!("weights ŵ, {away} px outside (largest {largest:.2})"));
    let tangent = (BALL.distance.powi(2) - BALL.radius.powi(2)).sqrt();
    let ends = [axes.at(tangent, 0.0), axes.at(tangent, 0.6)];
    out.line(ends[0], ends[1], "stroke=\"#1f77b4\" stroke-dasharray=\"3 3\"");
    for visit in &visits {
        let (foot, tip) = (axes.at(visit.t, 0.0), axes.at(visit.t, visit.weight));
        if visit.weight > 0.0 {
            out.line(foot, tip, "stroke=\"#d62728\" stroke-width=\"2\"");
        } else {
            out.circle(foot, 2.0, "fill=\"white\" stroke=\"#d62728\"");
        }
    }
}
