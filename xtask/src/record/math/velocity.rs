//! The error of the warp beside a silhouette, against the velocity of the silhouette.

use sweep::measure::plot::{Corner, Curve, Panel, svg_with_legends};

use super::ball::{BALL, Parameter, SETTINGS, Settings};

/// Exponents of the first panel, with 600 points.
const GAMMA: [f64; 4] = [1.0, 2.0, 3.0, 6.0];

/// Numbers of points of the second panel, with the exponent 3.
const POINTS: [usize; 4] = [22, 64, 200, 600];

/// Distances per decade, and decades below one pixel, of which the last is left out.
const PER_DECADE: i32 = 6;
const DECADES: i32 = 6;

/// The plot.
pub(super) fn draw() -> String {
    let all = |points, gamma| Settings { points, top_k: points + 1, gamma, ..SETTINGS };
    let of_gamma = |gamma| curve(format!("γ = {gamma}"), &all(600, gamma));
    let of_points = |points| curve(format!("N = {points}"), &all(points, 3.0));
    let panel =
        |title: &str, curves: Vec<Curve>| Panel { title: title.to_owned(), curves, front: false };
    let panels = [
        panel("exponent γ, N = 600", GAMMA.map(of_gamma).into()),
        panel("number of points N, γ = 3", POINTS.map(of_points).into()),
    ];
    let labels = ["distance outside the outline, pixels", "|V·n − v| / v"];
    // The upper corners have curves.
    svg_with_legends(&panels, labels, Corner::LowerLeft)
}

/// |V·n − v|/v beside the outline, for a ball that moves towards the camera.
fn curve(name: String, settings: &Settings) -> Curve {
    let exact = BALL.velocity(Parameter::Center(2), [1.0, 0.0]);
    let at = |i: i32| {
        let away = 10f64.powf(f64::from(i) / f64::from(PER_DECADE));
        let u = [BALL.principal + BALL.outline() + away, BALL.principal];
        let v = BALL.warp(u, Parameter::Center(2), settings)[0];
        (away, (v / exact - 1.0).abs().max(1e-4))
    };
    Curve { name, points: (-PER_DECADE * DECADES..=-PER_DECADE).map(at).collect() }
}
