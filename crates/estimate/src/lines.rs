//! Silhouettes along lines of the film.

use field::{Real, SurfaceBatch, Vector3};
use glam::DVec2;
use rustc_hash::FxHashMap;
use trace::{Outcome, RayFamily, Start, Tangency, tangencies};

use super::neighbours::Neighbours;
use super::pixels::{check_valid, first_invalid};
use super::{Sample, Setup};
use crate::InvalidField;

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

/// How well a crossing is known, in pixels: 1e-4, or 1e-3 in single precision. A silhouette that is
/// off by so much changes nothing that an image shows.
pub(super) fn tolerance<R: Real>() -> f64 {
    (R::epsilon().to_double() * 1e4).max(1e-4)
}

/// What a place of a line sees: a ray of its own, or one side of a crossing.
#[derive(Clone, Copy, Debug)]
struct Probe<R> {
    s: f64,
    /// The depth of the surface; infinite if there is none.
    depth: R,
    /// The distance of the closest approach and the angle by which the ray clears it; infinite if
    /// there is none.
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

/// Searches for silhouettes: where each starts, and what it belongs to.
pub(super) struct Searches<R> {
    starts: Vec<Start<R>>,
    origins: Vec<Origin>,
}

/// What a search belongs to.
#[derive(Clone, Copy, Debug)]
struct Origin {
    line: usize,
    /// What it may find lies between these.
    between: [f64; 2],
}

impl<R: Real> Searches<R> {
    pub(super) fn new() -> Self {
        Searches { starts: Vec::new(), origins: Vec::new() }
    }

    /// Adds a search along `line` from the ray at `s` and the distance `t`.
    pub(super) fn push(
        &mut self,
        line: usize,
        s: f64,
        t: R,
        between: [f64; 2],
        reach: R,
        steepest: f64,
    ) {
        self.starts.push(Start {
            s: R::of(s),
            t,
            range: between.map(R::of),
            reach,
            steepest: R::of(steepest),
        });
        self.origins.push(Origin { line, between });
    }
}

/// The rays of searches: a film line each.
struct Fans<'a, R: Real> {
    setup: &'a Setup<'a, R>,
    lines: Vec<Line>,
}

impl<R: Real> RayFamily<R> for Fans<'_, R> {
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

/// The silhouettes that lines cross, whether they are seen or not.
pub(super) struct Known<R: Real> {
    all: Vec<Found<R>>,
    of_line: Vec<Vec<usize>>,
}

/// A silhouette that a line crosses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found<R: Real> {
    pub(super) line: usize,
    pub(super) tangency: Tangency<R>,
}

impl<R: Real> Known<R> {
    /// Those of a line.
    pub(super) fn of(&self, line: usize) -> impl Iterator<Item = &Tangency<R>> {
        self.of_line[line].iter().map(|&i| &self.all[i].tangency)
    }

    /// Adds a silhouette unless it is known.
    fn add(&mut self, found: Found<R>, same: R) {
        let near = |other: &Tangency<R>| {
            (other.s - found.tangency.s).to_double().abs() < 10.0 * tolerance::<R>()
                && (other.t - found.tangency.t).abs() < same
        };
        if self.of_line[found.line].len() < CROSSINGS && !self.of(found.line).any(near) {
            self.of_line[found.line].push(self.all.len());
            self.all.push(found);
        }
    }
}

/// Rounds of halving an interval whose ends see different things before it is left alone.
const HALVINGS: u32 = 12;

/// Silhouettes and rays of one line at most: on a surface that is nowhere and everywhere (a solid
/// without its own points) a search would find ever more.
const CROSSINGS: usize = 64;
const PROBES: usize = 256;

/// Finds the visible silhouettes that lines cross. `inner` is the place of each line's probe
/// between its ends. Also counts the rays.
///
/// A silhouette is found from a ray that passes it by with nothing in between (the tracer's record
/// of its closest approach), by Newton's method; from there it is followed to the lines beside, so
/// that what is thin is found by all lines once one ray has seen it. Where two rays see different
/// surfaces and no crossing explains it, rays are added halfway. What lies between all probes of a
/// pixel and shows in none is not found: more probes find it.
pub(super) fn crossings<R: Real>(
    setup: &Setup<'_, R>,
    lines: &[Line],
    inner: &[f64],
) -> Result<(Vec<Crossing<R>>, u64), InvalidField> {
    let all: Vec<(usize, f64)> =
        (0..lines.len()).flat_map(|l| [0.0, inner[l], 1.0].map(|s| (l, s))).collect();
    let mut probes = Probes { of_line: vec![Vec::new(); lines.len()], rays: 0 };
    probes.add(setup, lines, &all)?;
    let mut known = Known { all: Vec::new(), of_line: vec![Vec::new(); lines.len()] };
    let (neighbours, mut seen): (Neighbours, Vec<Crossing<R>>) =
        (Neighbours::new(lines), Vec::new());
    let mut fresh: Vec<(usize, f64)> = all;
    for _ in 0..HALVINGS {
        let mut searches = probes.approaches(setup, lines, &fresh);
        while !searches.starts.is_empty() {
            let before = known.all.len();
            search(setup, lines, &searches, &mut known);
            for (crossing, inside, outside) in visible(setup, lines, &known.all[before..])? {
                probes.close(&crossing, inside, outside);
                seen.push(crossing);
            }
            searches = neighbours.searches(setup, lines, &known, &known.all[before..]);
        }
        fresh = probes.unexplained(setup, lines);
        if fresh.is_empty() {
            break;
        }
        probes.add(setup, lines, &fresh)?;
    }
    Ok((seen, probes.rays + known.all.len() as u64))
}

impl<R: Real> Probes<R> {
    fn add(
        &mut self,
        setup: &Setup<'_, R>,
        lines: &[Line],
        places: &[(usize, f64)],
    ) -> Result<(), InvalidField> {
        // A search starts at the closest approach that a ray has seen, so rays need room around the
        // solid.
        let setup = &Setup { within: setup.bounds, ..*setup };
        let samples: Vec<Sample> = places.iter().map(|(line, s)| lines[*line].at(*s)).collect();
        let (_, found) = setup.find(&samples);
        check_valid(setup, &samples, first_invalid(&found))?;
        self.rays += samples.len() as u64;
        for (((line, s), sample), found) in places.iter().zip(&samples).zip(found) {
            let depth = found.filter(|f| f.outcome == Outcome::Hit).map_or(R::infinity(), |f| f.t);
            let (nearest, clearance) =
                found.map_or_else(|| setup.beside(sample), |f| (f.nearest, f.clearance));
            self.insert(
                *line,
                Probe { s: *s, depth, nearest, clearance, side: false, crosses: false },
            );
        }
        Ok(())
    }

    /// Searches from the closest approaches of the probes at `places`.
    fn approaches(
        &self,
        setup: &Setup<'_, R>,
        lines: &[Line],
        places: &[(usize, f64)],
    ) -> Searches<R> {
        let mut searches = Searches::new();
        for &(line, s) in places {
            let of_line = &self.of_line[line];
            let Some(at) = of_line.iter().position(|p| p.s == s && !p.side) else { continue };
            let probe = of_line[at];
            let before = of_line[..at].iter().rev().map(|p| p.s).find(|p| *p < s).unwrap_or(s);
            let after = of_line[at..].iter().map(|p| p.s).find(|p| *p > s).unwrap_or(s);
            let room = [before - 2.0 * tolerance::<R>(), after + 2.0 * tolerance::<R>()];
            // No part of a silhouette is nearer than this, along the line or not; a little room for
            // f that is no distance.
            let away = (probe.clearance / R::of(setup.cameras[lines[line].camera].pixel_angle()))
                .to_double();
            let least = |t: R| least_reach(setup, lines[line].camera, t);
            if away < 2.0 * (s - before).max(after - s) {
                let least = least(probe.nearest);
                let reach = (probe.clearance * probe.nearest).max(least);
                searches.push(line, s, probe.nearest, room, reach, 1.0);
            }
            // A gap between two surfaces shows in the rays beside it by how these graze.
            if probe.depth.is_finite() {
                searches.push(line, s, probe.depth, room, least(probe.depth), GRAZING);
            }
        }
        searches
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
            for pair in probes.windows(2).take_while(|_| probes.len() < PROBES) {
                let width = pair[1].s - pair[0].s;
                if width > tolerance::<R>()
                    && !pair[0].crosses
                    && jumps(setup, &lines[line], pair, width)
                {
                    middles.push((line, (pair[0].s + pair[1].s) * 0.5));
                }
            }
        }
        middles
    }
}

/// Whether two probes at a distance of `width` pixels see different surfaces: one and none, or
/// depths that differ by more than those of a ball as large as the bounds, from its silhouette on
/// inwards, can.
fn jumps<R: Real>(setup: &Setup<'_, R>, line: &Line, pair: &[Probe<R>], width: f64) -> bool {
    let (a, b) = (pair[0].depth, pair[1].depth);
    if a.is_infinite() || b.is_infinite() {
        return a != b;
    }
    let world = R::of(width * setup.cameras[line.camera].pixel_angle()) * a.min(b);
    (a - b).abs() > (setup.scale_at(line.camera, a.min(b)) * world * R::of(8.0)).sqrt()
}

/// Runs searches, and adds what was not known.
fn search<R: Real>(
    setup: &Setup<'_, R>,
    lines: &[Line],
    searches: &Searches<R>,
    known: &mut Known<R>,
) {
    let Searches { starts, origins } = searches;
    let fans = Fans { setup, lines: origins.iter().map(|o| lines[o.line]).collect() };
    let found = tangencies(setup.field, &fans, starts, R::of(tolerance::<R>()));
    for (tangency, origin) in found.into_iter().zip(origins) {
        let Some(tangency) = tangency else { continue };
        let s = tangency.s.to_double();
        if s >= origin.between[0] && s <= origin.between[1] && (0.0..1.0).contains(&s) {
            let same = setup.scale_at(lines[origin.line].camera, tangency.t) * R::of(SAME);
            known.add(Found { line: origin.line, tangency }, same);
        }
    }
}

/// The first guess at the width of a minimum of f along a ray, in bounding radii; a pixel if that
/// is less.
const REACH: f64 = 0.02;

/// The first guess at the width of a minimum that is `t` away.
pub(super) fn least_reach<R: Real>(setup: &Setup<'_, R>, camera: usize, t: R) -> R {
    (setup.bounds.radius * R::of(REACH)).min(R::of(setup.cameras[camera].pixel_angle()) * t)
}

/// Silhouettes may lie outside of the bounds by this part of their radius, for rounding.
const SLACK: f64 = 1e-3;

/// A hit whose ray is steeper than this, as a cosine to the normal, is not near a silhouette.
const GRAZING: f64 = 0.65;

/// Silhouettes of one line that are this close in depth, in [`Setup::scale_at`], and as close on
/// the film as they are known, are one.
const SAME: f64 = 0.02;

/// Twice the half chord of a parabola at the depth of its minimum, in roots of depth over second
/// derivative: 2 √2.
const CHORD: f64 = 3.0;

/// Looks past every silhouette, and keeps those that nothing hides, with the depths seen inside and
/// outside.
#[allow(clippy::type_complexity, reason = "a crossing with its two sides")]
fn visible<R: Real>(
    setup: &Setup<'_, R>,
    lines: &[Line],
    found: &[Found<R>],
) -> Result<Vec<(Crossing<R>, R, R)>, InvalidField> {
    let aside = 10.0 * tolerance::<R>();
    let beside = |f: &Found<R>, away: f64| {
        let away = if f.tangency.slope > R::zero() { away } else { -away };
        lines[f.line].at(f.tangency.s.to_double() + away)
    };
    let samples: Vec<Sample> = found.iter().map(|f| beside(f, aside)).collect();
    let beyond = setup.primary(&samples);
    check_valid(setup, &samples, beyond.invalid)?;
    // At an edge one of two faces is in sight, and a ray has to say which.
    let edges: Vec<usize> = (0..found.len()).filter(|&i| found[i].tangency.edge).collect();
    let samples: Vec<Sample> = edges.iter().map(|&i| beside(&found[i], -aside)).collect();
    let within = setup.primary(&samples);
    check_valid(setup, &samples, within.invalid)?;
    let mut shown: FxHashMap<usize, (R, R::Vec3)> = within
        .hits
        .iter()
        .zip(&within.t)
        .map(|(&i, t)| (edges[i], (*t, within.radiance[i])))
        .collect();
    let mut seen = Vec::with_capacity(found.len());
    let (mut x, mut normal, mut direction, mut inside) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (i, f) in found.iter().enumerate() {
        let (line, tangency) = (&lines[f.line], &f.tangency);
        let depth = match beyond.found[i] {
            Some(hit) if hit.outcome != Outcome::Miss => hit.t,
            _ => R::infinity(),
        };
        // A ray that should pass beside the surface, and does not, enters it this far before the
        // minimum at most.
        let chord = R::of(CHORD) * (tangency.slope.abs() * R::of(aside) / tangency.bend).sqrt();
        if depth < tangency.t - chord.min(setup.scale_at(line.camera, tangency.t) * R::of(SAME)) {
            continue;
        }
        let sample = line.at(tangency.s.to_double());
        let camera = &setup.cameras[sample.camera];
        let (d, du) = camera.direction_du(sample.u);
        let rise = du.map(|du| tangency.gradient.dot(R::Vec3::of(du)) * tangency.t);
        let d = R::Vec3::of(d);
        let point = R::Vec3::of(camera.eye) + d * tangency.t;
        // Nothing outside of the bounds is seen.
        if (point - setup.bounds.center).length() > setup.bounds.radius * R::of(1.0 + SLACK) {
            continue;
        }
        x.push(point);
        direction.push(d);
        normal.push(
            tangency.gradient
                * (R::one() / tangency.gradient.length().max(R::min_positive_value())),
        );
        // Unless it has passed through all of a thing that is thinner yet.
        inside.push(shown.remove(&i).filter(|(t, _)| *t < depth).map(|(_, rgb)| rgb));
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
    let points = SurfaceBatch { x: &x, normal: &normal, direction: &direction };
    setup.shader.radiance(&points, &mut rgb);
    for (((crossing, ..), rgb), inside) in seen.iter_mut().zip(rgb).zip(inside) {
        crossing.contrast += inside.unwrap_or(rgb);
    }
    Ok(seen)
}
