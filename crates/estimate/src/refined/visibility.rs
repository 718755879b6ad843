//! Which of the silhouettes on lines are visible, and their contrast.

use field::{Real, Vector3};
use render::{InvalidField, Primary, Sample, Scene, Surface};
use rustc_hash::FxHashMap;
use trace::{Outcome, Tangency};

use super::search::{LineTangency, SAME_DEPTH};
use crate::film_line::{Crossing, FilmLine, tolerance};

/// A crossing with the depths on both of its sides.
pub(super) struct VisibleCrossing<R: Real> {
    pub(super) crossing: Crossing<R>,
    /// The depth of the silhouette.
    pub(super) inside: R,
    /// The depth of the surface beside it; infinite if there is none.
    pub(super) outside: R,
}

/// Silhouettes outside the bounds by up to this, in bounding radii, count as inside: rounding.
const BOUNDS_SLACK: f64 = 1e-3;

/// Twice the half chord of a parabola at the depth of its minimum, in √(depth/second derivative):
/// 2 √2, rounded up.
const CHORD: f64 = 3.0;

/// The distance from a silhouette at which rays look past it, in tolerances.
const ASIDE: f64 = 10.0;

/// The silhouettes that nothing hides. A ray just outside each tells whether something is in front
/// of it, and the radiance there.
pub(super) fn visible<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    found: &[LineTangency<R>],
) -> Result<Vec<VisibleCrossing<R>>, InvalidField> {
    let aside = ASIDE * tolerance::<R>();
    let outside: Vec<Sample> = found.iter().map(|f| beside(lines, f, aside)).collect();
    let outside = scene.primary(&outside)?;
    let mut inside = inside_edges(scene, lines, found, aside)?;
    let mut out = Vec::with_capacity(found.len());
    let (mut surface, mut inside_radiance) = (Surface::default(), Vec::new());
    for (i, f) in found.iter().enumerate() {
        let (line, tangency) = (&lines[f.line], &f.tangency);
        let depth = depth_outside(&outside, i);
        if hidden(scene, line, tangency, depth, aside) {
            continue;
        }
        let sample = line.at(tangency.s.to_double());
        let camera = &scene.cameras[sample.camera];
        let (d, du) = camera.direction_du(sample.u);
        let d = R::Vec3::of(d);
        let point = R::Vec3::of(camera.eye) + d * tangency.t;
        if is_outside_bounds(scene, point) {
            continue;
        }
        let length = tangency.gradient.length().max(R::min_positive_value());
        surface.push(point, tangency.gradient * (R::one() / length), d);
        // A ray that has passed through all of a part thinner than `aside` sees what is behind it.
        let seen = inside.remove(&i).filter(|(t, _)| *t < depth);
        inside_radiance.push(seen.map(|(_, rgb)| rgb));
        let crossing = Crossing {
            line: f.line,
            s: tangency.s.to_double(),
            leaves: tangency.slope > R::zero(),
            points: tangency.points,
            weights: tangency.weights,
            film_gradient: du.map(|du| tangency.gradient.dot(R::Vec3::of(du)) * tangency.t),
            contrast: -outside.samples[i].radiance,
        };
        out.push(VisibleCrossing { crossing, inside: tangency.t, outside: depth });
    }
    let mut rgb = vec![R::Vec3::zero(); out.len()];
    scene.shader.radiance(&surface.batch(), &mut rgb);
    for ((visible, rgb), inside) in out.iter_mut().zip(rgb).zip(inside_radiance) {
        visible.crossing.contrast += inside.unwrap_or(rgb);
    }
    Ok(out)
}

/// The sample beside a silhouette, `away` pixels outside the solid.
fn beside<R: Real>(lines: &[FilmLine], f: &LineTangency<R>, away: f64) -> Sample {
    let away = if f.tangency.slope > R::zero() { away } else { -away };
    lines[f.line].at(f.tangency.s.to_double() + away)
}

/// Depth and radiance just inside the silhouettes that are edges, by their numbers: one of two faces
/// is visible there, and only a ray tells which.
fn inside_edges<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    found: &[LineTangency<R>],
    aside: f64,
) -> Result<FxHashMap<usize, (R, R::Vec3)>, InvalidField> {
    let edges: Vec<usize> = (0..found.len()).filter(|&i| found[i].tangency.edge).collect();
    let samples: Vec<Sample> = edges.iter().map(|&i| beside(lines, &found[i], -aside)).collect();
    let inside = scene.primary(&samples)?;
    let view =
        |hit: &render::Hit<R>| (edges[hit.sample], (hit.t, inside.samples[hit.sample].radiance));
    Ok(inside.hits.iter().map(view).collect())
}

/// The depth just outside silhouette `i`; infinite for a miss.
fn depth_outside<R: Real>(outside: &Primary<R>, i: usize) -> R {
    match outside.samples[i].traced {
        Some(traced) if traced.found.outcome != Outcome::Miss => traced.found.t,
        _ => R::infinity(),
    }
}

/// Whether the surface at `depth` beside a silhouette is in front of it.
fn hidden<R: Real>(
    scene: &Scene<'_, R>,
    line: &FilmLine,
    tangency: &Tangency<R>,
    depth: R,
    aside: f64,
) -> bool {
    // A ray that should pass the surface, and by an error of the silhouette's position enters it,
    // does so at most this far before the minimum.
    let chord = R::of(CHORD) * (tangency.slope.abs() * R::of(aside) / tangency.bend).sqrt();
    let same = scene.tracing_scale(line.camera, tangency.t) * R::of(SAME_DEPTH);
    depth < tangency.t - chord.min(same)
}

/// Whether a point is outside the bounds, where nothing is visible.
fn is_outside_bounds<R: Real>(scene: &Scene<'_, R>, point: R::Vec3) -> bool {
    let ball = scene.bounding_ball();
    (point - ball.center).length() > ball.radius * R::of(1.0 + BOUNDS_SLACK)
}
