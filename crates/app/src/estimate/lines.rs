//! Silhouettes along lines of the film.

use field::{Real, Vector3};
use glam::DVec2;
use trace::{Outcome, Start, Tangency, Turn, tangencies};

use super::pixels::{check_valid, first_invalid};
use super::{Sample, Setup};
use crate::error::InvalidField;

/// A line across a pixel along a film axis: s in [0, 1] runs from one border to the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Line {
    pub(super) pixel: u32,
    pub(super) camera: usize,
    /// The film axis that s runs along.
    pub(super) axis: usize,
    pub(super) start: DVec2,
    /// The part of the pixel that the line stands for.
    pub(super) share: f64,
}

impl Line {
    /// The film sample at s.
    pub(super) fn at(&self, s: f64) -> Sample {
        let mut u = self.start;
        u[self.axis] += s;
        Sample { camera: self.camera, u }
    }
}

/// A place where a line crosses a silhouette that is seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossing<R: Real> {
    pub(super) line: usize,
    pub(super) s: f64,
    /// Whether the solid is left as s grows.
    pub(super) leaves: bool,
    /// The points on both sides of the minimum of f, with their weights.
    pub(super) points: [R::Vec3; 2],
    pub(super) weights: [R; 2],
    /// ∇_u m of m = min_t f, per pixel.
    pub(super) rise: [R; 2],
    /// What is seen inside less what is seen outside.
    pub(super) contrast: R::Vec3,
}

/// How well a crossing is known, in pixels: 1e-4, or 1e-3 in single precision. A silhouette that is off by so much changes nothing
/// that an image shows.
fn tolerance<R: Real>() -> f64 {
    (R::epsilon().to_double() * 1e4).max(1e-4)
}

/// What a place of a line sees: a ray of its own, or one side of a crossing.
#[derive(Clone, Copy, Debug)]
struct Probe<R> {
    s: f64,
    /// The depth of the surface; infinite if there is none.
    depth: R,
    /// The distance of the closest approach and the angle by which the ray clears it; infinite if there is none.
    nearest: R,
    clearance: R,
    /// Whether this is a side of a crossing.
    side: bool,
    /// Whether the next probe is the far side of the same crossing.
    crosses: bool,
}

/// The probes of every line, in order.
struct Probes<R> {
    of_line: Vec<Vec<Probe<R>>>,
    rays: u64,
}

/// What a search belongs to.
#[derive(Clone, Copy, Debug)]
struct Origin {
    line: usize,
    /// The probes that it lies between.
    between: [f64; 2],
}

/// The rays of searches: a film line each.
struct Fans<'a, R: Real> {
    setup: &'a Setup<'a, R>,
    lines: Vec<Line>,
}

impl<R: Real> Turn<R> for Fans<'_, R> {
    fn origin(&self, index: usize) -> R::Vec3 {
        R::Vec3::of(self.setup.cameras[self.lines[index].camera].eye)
    }
    fn direction(&self, index: usize, s: R) -> (R::Vec3, R::Vec3) {
        let line = &self.lines[index];
        let sample = line.at(s.to_double());
        let (d, du) = self.setup.cameras[sample.camera].direction_du(sample.u);
        (R::Vec3::of(d), R::Vec3::of(du[line.axis]))
    }
}

/// A silhouette that a line crosses, whether it is seen or not.
#[derive(Clone, Copy, Debug)]
struct Found<R: Real> {
    line: usize,
    tangency: Tangency<R>,
}

/// Rounds of halving an interval whose ends see different things before it is left alone.
const HALVINGS: u32 = 12;

/// Finds the visible silhouettes that lines cross. `inner` is the place of each line's probe between its ends. Also counts the
/// rays.
///
/// A silhouette is found from a ray that passes it by with nothing in between (the tracer's record of its closest approach),
/// by Newton's method; where two rays see different surfaces and no crossing explains it, rays are added halfway.
/// What lies between two probes and shows in neither is not found: more probes find it.
pub(super) fn crossings<R: Real>(
    setup: &Setup<'_, R>,
    lines: &[Line],
    inner: &[f64],
) -> Result<(Vec<Crossing<R>>, u64), InvalidField> {
    let all: Vec<(usize, f64)> = (0..lines.len()).flat_map(|l| [0.0, inner[l], 1.0].map(|s| (l, s))).collect();
    let mut probes = Probes { of_line: vec![Vec::new(); lines.len()], rays: 0 };
    probes.add(setup, lines, &all)?;
    let (mut known, mut seen): (Vec<Found<R>>, Vec<Crossing<R>>) = (Vec::new(), Vec::new());
    let mut fresh: Vec<(usize, f64)> = all;
    for _ in 0..HALVINGS {
        let before = known.len();
        search(setup, lines, &probes, &fresh, &mut known);
        for (crossing, inside, outside) in visible(setup, lines, &known[before..])? {
            probes.close(&crossing, inside, outside);
            seen.push(crossing);
        }
        fresh = probes.unexplained(setup, lines);
        if fresh.is_empty() {
            break;
        }
        probes.add(setup, lines, &fresh)?;
    }
    Ok((seen, probes.rays + known.len() as u64))
}

impl<R: Real> Probes<R> {
    fn add(&mut self, setup: &Setup<'_, R>, lines: &[Line], places: &[(usize, f64)]) -> Result<(), InvalidField> {
        let samples: Vec<Sample> = places.iter().map(|(line, s)| lines[*line].at(*s)).collect();
        let (_, found) = setup.find(&samples);
        check_valid(setup, &samples, first_invalid(&found))?;
        self.rays += samples.len() as u64;
        for ((line, s), found) in places.iter().zip(found) {
            let depth = found.filter(|f| f.outcome == Outcome::Hit).map_or(R::infinity(), |f| f.t);
            let (nearest, clearance) = found.map_or((R::zero(), R::infinity()), |f| (f.nearest, f.clearance));
            self.insert(*line, Probe { s: *s, depth, nearest, clearance, side: false, crosses: false });
        }
        Ok(())
    }

    /// Inserts a probe behind those that are not further along its line.
    fn insert(&mut self, line: usize, probe: Probe<R>) {
        let of_line = &mut self.of_line[line];
        let at = of_line.partition_point(|p| p.s <= probe.s);
        of_line.insert(at, probe);
    }

    /// Tells what is seen on both sides of a crossing.
    fn close(&mut self, crossing: &Crossing<R>, inside: R, outside: R) {
        let (first, second) = if crossing.leaves { (inside, outside) } else { (outside, inside) };
        let side = |depth, crosses| Probe {
            s: crossing.s,
            depth,
            nearest: R::zero(),
            clearance: R::infinity(),
            side: true,
            crosses,
        };
        self.insert(crossing.line, side(first, true));
        self.insert(crossing.line, side(second, false));
    }

    /// The middles of intervals whose ends see different surfaces, with no crossing to tell why.
    fn unexplained(&self, setup: &Setup<'_, R>, lines: &[Line]) -> Vec<(usize, f64)> {
        let mut middles = Vec::new();
        for (line, probes) in self.of_line.iter().enumerate() {
            for pair in probes.windows(2) {
                let width = pair[1].s - pair[0].s;
                if width > tolerance::<R>() && !pair[0].crosses && jumps(setup, &lines[line], pair, width) {
                    middles.push((line, (pair[0].s + pair[1].s) * 0.5));
                }
            }
        }
        middles
    }
}

/// Whether two probes at a distance of `width` pixels see different surfaces: one and none, or depths that differ by more than
/// those of a ball as large as the bounds, from its silhouette on inwards, can.
fn jumps<R: Real>(setup: &Setup<'_, R>, line: &Line, pair: &[Probe<R>], width: f64) -> bool {
    let (a, b) = (pair[0].depth, pair[1].depth);
    if a.is_infinite() || b.is_infinite() {
        return a != b;
    }
    let world = R::of(width * setup.cameras[line.camera].pixel_angle()) * a.min(b);
    (a - b).abs() > (setup.bounds.radius * world * R::of(8.0)).sqrt()
}

/// Searches from the closest approaches of the probes at `places`, and adds what was not known.
fn search<R: Real>(
    setup: &Setup<'_, R>,
    lines: &[Line],
    probes: &Probes<R>,
    places: &[(usize, f64)],
    found: &mut Vec<Found<R>>,
) {
    let (mut starts, mut origins) = (Vec::new(), Vec::new());
    for &(line, s) in places {
        let of_line = &probes.of_line[line];
        let Some(at) = of_line.iter().position(|p| p.s == s && !p.side) else { continue };
        let probe = of_line[at];
        let before = of_line[..at].iter().rev().map(|p| p.s).find(|p| *p < s).unwrap_or(s);
        let after = of_line[at..].iter().map(|p| p.s).find(|p| *p > s).unwrap_or(s);
        let room = [before - 2.0 * tolerance::<R>(), after + 2.0 * tolerance::<R>()];
        let least = setup.bounds.radius * R::of(REACH);
        let mut start = |t: R, reach: R, steepest: f64| {
            let (s, range) = (R::of(s), room.map(R::of));
            starts.push(Start { s, t, range, reach, steepest: R::of(steepest) });
            origins.push(Origin { line, between: room });
        };
        // No part of a silhouette is nearer than this, along the line or not; a little room for f that is no distance.
        let away = (probe.clearance / R::of(setup.cameras[lines[line].camera].pixel_angle())).to_double();
        if away < 2.0 * (s - before).max(after - s) {
            start(probe.nearest, (probe.clearance * probe.nearest).max(least), 1.0);
        }
        // A gap between two surfaces shows in the rays beside it by how these graze.
        if probe.depth.is_finite() {
            start(probe.depth, least, GRAZING);
        }
    }
    let fans = Fans { setup, lines: origins.iter().map(|o| lines[o.line]).collect() };
    let tolerance = tolerance::<R>();
    for (tangency, origin) in tangencies(setup.field, &fans, &starts, R::of(tolerance)).into_iter().zip(&origins) {
        let Some(tangency) = tangency else { continue };
        let s = tangency.s.to_double();
        let inside = s >= origin.between[0] && s <= origin.between[1] && (0.0..1.0).contains(&s);
        let near = |other: &Found<R>| {
            other.line == origin.line
                && (other.tangency.s - tangency.s).to_double().abs() < 10.0 * tolerance
                && (other.tangency.t - tangency.t).abs() < setup.bounds.radius * R::of(SAME)
        };
        if inside && !found.iter().any(near) {
            found.push(Found { line: origin.line, tangency });
        }
    }
}

/// The first guess at the width of a minimum of f along a ray, in bounding radii.
const REACH: f64 = 0.02;

/// A hit whose ray is steeper than this, as a cosine to the normal, is not near a silhouette.
const GRAZING: f64 = 0.65;

/// Silhouettes of one line that are this close in depth, in bounding radii, and as close on the film as they are known, are one.
const SAME: f64 = 0.02;

/// Looks past every silhouette, and keeps those that nothing hides, with the depths seen inside and outside.
#[allow(clippy::type_complexity, reason = "a crossing with its two sides")]
fn visible<R: Real>(
    setup: &Setup<'_, R>,
    lines: &[Line],
    found: &[Found<R>],
) -> Result<Vec<(Crossing<R>, R, R)>, InvalidField> {
    let aside = 10.0 * tolerance::<R>();
    let outside = |f: &Found<R>| {
        let away = if f.tangency.slope > R::zero() { aside } else { -aside };
        lines[f.line].at(f.tangency.s.to_double() + away)
    };
    let samples: Vec<Sample> = found.iter().map(outside).collect();
    let beyond = setup.primary(&samples);
    check_valid(setup, &samples, beyond.invalid)?;
    let mut seen = Vec::with_capacity(found.len());
    let (mut x, mut normal, mut direction) = (Vec::new(), Vec::new(), Vec::new());
    for (i, f) in found.iter().enumerate() {
        let (line, tangency) = (&lines[f.line], &f.tangency);
        let depth = match beyond.found[i] {
            Some(hit) if hit.outcome != Outcome::Miss => hit.t,
            _ => R::infinity(),
        };
        if depth < tangency.t - setup.bounds.radius * R::of(SAME) {
            continue;
        }
        let sample = line.at(tangency.s.to_double());
        let camera = &setup.cameras[sample.camera];
        let (d, du) = camera.direction_du(sample.u);
        let rise = du.map(|du| tangency.gradient.dot(R::Vec3::of(du)) * tangency.t);
        let d = R::Vec3::of(d);
        x.push(R::Vec3::of(camera.eye) + d * tangency.t);
        direction.push(d);
        let length = tangency.gradient.length().max(R::min_positive_value());
        normal.push(tangency.gradient * (R::one() / length));
        let crossing = Crossing {
            line: f.line,
            s: tangency.s.to_double(),
            leaves: tangency.slope > R::zero(),
            points: tangency.points,
            weights: tangency.weights,
            rise,
            contrast: -beyond.radiance[i],
        };
        seen.push((crossing, tangency.t, depth));
    }
    let mut rgb = vec![R::Vec3::zero(); x.len()];
    setup.shader.radiance(&x, &normal, &direction, &mut rgb);
    seen.iter_mut().zip(rgb).for_each(|((crossing, ..), rgb)| crossing.contrast += rgb);
    Ok(seen)
}
