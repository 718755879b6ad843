//! The visibility of silhouettes on lines, and their contrast.

use field::{Real, Vector3};
use render::{InvalidField, Primary, Sample, Scene, Surface};
use rustc_hash::FxHashMap;
use trace::{Outcome, Tangency};

use super::outside::move_grazing_hits;
use super::search::{LineTangency, SAME_DEPTH};
use crate::crossing::{Crossing, Rim, grazing_samples, tolerance};
use crate::record::FilmLine;

/// A crossing with the depths on both of its sides.
pub(super) struct VisibleCrossing<R: Real> {
    pub(super) crossing: Crossing<R>,
    /// The depth of the silhouette, in world units.
    pub(super) inside: R,
    /// The depth of the surface beside it, in world units; infinite if there is none.
    pub(super) outside: R,
}

/// Silhouettes up to this far outside the bounds, in bounding radii, count as inside: a margin for
/// rounding.
const BOUNDS_SLACK: f64 = 1e-3;

/// Twice the half chord of a parabola at the depth of its minimum, in √(depth/second derivative):
/// 2 √2, rounded up.
const CHORD: f64 = 3.0;

/// The distance on the film between a silhouette and the rays beside it, in tolerances: 1e-3
/// pixels, or 1e-2 pixels in single precision. At 3: error 1.01 (2.0 for one weight of a network),
/// evaluations 1.01. At 30: error 1.03 (1.4 at worst), evaluations 0.99.
const ASIDE: f64 = 10.0;

/// The distance on the film between a silhouette and the rays inside, in tolerances. A part of a
/// solid that is narrower on the film counts as its edge.
pub(super) const INSIDE: f64 = 3.0;

/// The visible ones among silhouettes, with their contrast.
///
/// A ray just outside each silhouette tests whether a surface in front hides it, and gives the
/// radiance outside. The shader gives the radiance inside; at an edge of a solid, a ray just inside
/// gives it, or the face before the edge if that ray misses the solid.
pub(super) fn visible<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    found: &[LineTangency<R>],
) -> Result<Vec<VisibleCrossing<R>>, InvalidField> {
    let aside = ASIDE * tolerance::<R>();
    let outside: Vec<Sample> = found.iter().map(|f| beside(lines, f, aside)).collect();
    let mut outside = scene.within_reach(0.0).primary(&outside)?;
    move_grazing_hits(scene, lines, found, &mut outside);
    let grazing_outside = grazing_samples(&outside);
    let mut inside = inside_edges(scene, lines, found)?;
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
        let normal = if tangency.edge { tangency.front } else { tangency.gradient };
        let length = normal.length().max(R::min_positive_value());
        surface.push(point, normal * (R::one() / length), d);
        // A ray just inside a part thinner than `INSIDE` misses it and hits a surface behind it.
        // The tracer can also miss a part as short along the ray as its shortest step.
        let half_way = (tangency.t + depth) * R::of(0.5);
        let seen = inside.remove(&i).filter(|(t, _)| *t < half_way);
        inside_radiance.push(seen.map(|(_, rgb)| rgb));
        let crossing = Crossing {
            line: f.line,
            s: tangency.s.to_double(),
            leaves: tangency.slope > R::zero(),
            points: tangency.points,
            weights: tangency.weights,
            film_gradient: du.map(|du| tangency.gradient.dot(R::Vec3::of(du)) * tangency.t),
            contrast: -outside.samples[i].radiance,
            coverage: if depth.is_finite() { R::zero() } else { R::one() },
            rim: Rim {
                t: tangency.t,
                x: point,
                gradient: normal,
                radiance: R::Vec3::zero(),
                edge: tangency.edge,
            },
            grazing_outside: grazing_outside[i],
        };
        out.push(VisibleCrossing { crossing, inside: tangency.t, outside: depth });
    }
    let mut rgb = vec![R::Vec3::zero(); out.len()];
    scene.shader.radiance(&surface.batch(), &mut rgb);
    for ((visible, rgb), inside) in out.iter_mut().zip(rgb).zip(inside_radiance) {
        let radiance = inside.unwrap_or(rgb);
        visible.crossing.contrast += radiance;
        visible.crossing.rim.radiance = radiance;
    }
    Ok(out)
}

/// The sample on the line, `away` pixels outside the silhouette.
fn beside<R: Real>(lines: &[FilmLine], f: &LineTangency<R>, away: f64) -> Sample {
    let away = if f.tangency.slope > R::zero() { away } else { -away };
    lines[f.line].at(f.tangency.s.to_double() + away)
}

/// Depth and radiance just inside the silhouettes that are edges of a solid, by their numbers. One
/// of two faces is visible there, and a ray finds it.
fn inside_edges<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    found: &[LineTangency<R>],
) -> Result<FxHashMap<usize, (R, R::Vec3)>, InvalidField> {
    let edges: Vec<usize> = (0..found.len()).filter(|&i| found[i].tangency.edge).collect();
    let samples: Vec<Sample> =
        edges.iter().map(|&i| beside(lines, &found[i], -INSIDE * tolerance::<R>())).collect();
    let inside = scene.primary(&samples)?;
    let view =
        |hit: &render::Hit<R>| (edges[hit.sample], (hit.t, inside.samples[hit.sample].radiance));
    Ok(inside.hits.iter().map(view).collect())
}

/// The depth just outside silhouette `i`; infinite for a miss.
fn depth_outside<R: Real>(outside: &Primary<R>, i: usize) -> R {
    match outside.ray_of(&outside.samples[i]) {
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
    // Because of the error of the silhouette's position, the ray may enter the surface that it
    // should pass. Then it does so at most this far before the minimum.
    let chord = R::of(CHORD) * (tangency.slope.abs() * R::of(aside) / tangency.bend).sqrt();
    let same = scene.tracing_scale(line.camera, tangency.t) * R::of(SAME_DEPTH);
    depth < tangency.t - chord.min(same)
}

/// Whether a point is outside the bounds, where no surface is visible.
fn is_outside_bounds<R: Real>(scene: &Scene<'_, R>, point: R::Vec3) -> bool {
    let ball = scene.bounding_ball();
    (point - ball.center).length() > ball.radius * R::of(1.0 + BOUNDS_SLACK)
}
