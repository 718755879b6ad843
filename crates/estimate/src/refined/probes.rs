//! Probes of lines: rays that tell which surfaces a line sees, and where to search.

use field::Real;
use render::{InvalidField, Sample, Scene};
use trace::Start;

use super::search::{Searches, first_reach};
use super::visibility::VisibleCrossing;
use crate::film_line::{FilmLine, tolerance};
use crate::silhouette_margin::GRAZING;

/// The view from one place of a line: that of a ray of its own, or of one side of a crossing.
#[derive(Clone, Copy, Debug)]
struct Probe<R> {
    s: f64,
    /// The depth of the surface; infinite if there is none.
    depth: R,
    /// The distance of the closest approach, and the angle by which the ray clears it; the angle is
    /// infinite if there is none.
    nearest: R,
    clearance: R,
    kind: ProbeKind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ProbeKind {
    /// A ray of its own.
    Ray,
    /// The near side of a crossing; the next probe is the far side.
    NearSide,
    /// The far side of a crossing.
    FarSide,
}

/// The probes of every line, in order.
pub(super) struct Probes<R> {
    of_line: Vec<Vec<Probe<R>>>,
    /// The number of rays traced.
    pub(super) rays: u64,
}

/// The most probes of one line; see `MAX_TANGENCIES`.
const MAX_PROBES: usize = 256;

/// A place on a line: the number of the line, and s.
pub(super) type Place = (usize, f64);

impl<R: Real> Probes<R> {
    pub(super) fn new(lines: usize) -> Self {
        Probes { of_line: vec![Vec::new(); lines], rays: 0 }
    }

    /// Traces a ray at every place.
    pub(super) fn add(
        &mut self,
        scene: &Scene<'_, R>,
        lines: &[FilmLine],
        places: &[Place],
    ) -> Result<(), InvalidField> {
        // A search starts at the closest approach of a ray, so rays need room around the solid.
        let scene = &scene.clipped_to_bounds();
        let samples: Vec<Sample> = places.iter().map(|(line, s)| lines[*line].at(*s)).collect();
        let traced = scene.trace(&samples)?;
        self.rays += samples.len() as u64;
        for (((line, s), sample), traced) in places.iter().zip(&samples).zip(traced) {
            let depth = traced.and_then(|traced| traced.depth()).unwrap_or(R::infinity());
            let (nearest, clearance) = traced.map_or_else(
                || scene.passing(sample),
                |traced| (traced.found.nearest, traced.found.clearance),
            );
            self.insert(*line, Probe { s: *s, depth, nearest, clearance, kind: ProbeKind::Ray });
        }
        Ok(())
    }

    /// Searches from the closest approaches of the rays at `places`, and from their grazing hits.
    pub(super) fn searches(
        &self,
        scene: &Scene<'_, R>,
        lines: &[FilmLine],
        places: &[Place],
    ) -> Searches<R> {
        let mut searches = Searches::new();
        for &(line, s) in places {
            let of_line = &self.of_line[line];
            let own = |p: &Probe<R>| p.s == s && p.kind == ProbeKind::Ray;
            let Some(at) = of_line.iter().position(own) else { continue };
            let probe = of_line[at];
            let before =
                of_line[..at].iter().rev().map(|p| p.s).find(|before| *before < s).unwrap_or(s);
            let after = of_line[at..].iter().map(|p| p.s).find(|after| *after > s).unwrap_or(s);
            let between = [before - 2.0 * tolerance::<R>(), after + 2.0 * tolerance::<R>()];
            let camera = lines[line].camera;
            let start = |t: R, reach: R, steepest: f64| Start {
                s: R::of(s),
                t,
                range: [R::zero(); 2],
                reach,
                steepest: R::of(steepest),
            };
            // No part of a silhouette is nearer than this, in pixels; a factor of two is room for
            // an f that is no distance.
            let pixel_angle = R::of(scene.cameras[camera].pixel_angle());
            let away = (probe.clearance / pixel_angle).to_double();
            if away < 2.0 * (s - before).max(after - s) {
                let least = first_reach(scene, camera, probe.nearest);
                let reach = (probe.clearance * probe.nearest).max(least);
                searches.push(line, between, start(probe.nearest, reach, 1.0));
            }
            // A gap between two surfaces shows in the rays beside it, which graze them.
            if probe.depth.is_finite() {
                let reach = first_reach(scene, camera, probe.depth);
                searches.push(line, between, start(probe.depth, reach, GRAZING));
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

    /// Adds the views from both sides of a crossing.
    pub(super) fn add_sides(&mut self, visible: &VisibleCrossing<R>) {
        let VisibleCrossing { crossing, inside, outside } = visible;
        let (first, second) =
            if crossing.leaves { (*inside, *outside) } else { (*outside, *inside) };
        for (depth, kind) in [(first, ProbeKind::NearSide), (second, ProbeKind::FarSide)] {
            let (nearest, clearance) = (R::zero(), R::infinity());
            self.insert(crossing.line, Probe { s: crossing.s, depth, nearest, clearance, kind });
        }
    }

    /// The middles of intervals whose ends see different surfaces, without a crossing between them.
    pub(super) fn unexplained(&self, scene: &Scene<'_, R>, lines: &[FilmLine]) -> Vec<Place> {
        let mut middles = Vec::new();
        for (line, probes) in self.of_line.iter().enumerate() {
            for pair in probes.windows(2).take_while(|_| probes.len() < MAX_PROBES) {
                let width = pair[1].s - pair[0].s;
                let explained = pair[0].kind == ProbeKind::NearSide;
                let depths = [pair[0].depth, pair[1].depth];
                if width > tolerance::<R>()
                    && !explained
                    && jumps(scene, lines[line].camera, depths, width)
                {
                    middles.push((line, (pair[0].s + pair[1].s) * 0.5));
                }
            }
        }
        middles
    }
}

/// Whether two depths at a distance of `width` pixels are of different surfaces: one of a surface
/// and one of none, or a difference larger than that of a ball as large as the tracing scale, from
/// its silhouette inwards.
fn jumps<R: Real>(scene: &Scene<'_, R>, camera: usize, [a, b]: [R; 2], width: f64) -> bool {
    if a.is_infinite() || b.is_infinite() {
        return a != b;
    }
    let world = R::of(width * scene.cameras[camera].pixel_angle()) * a.min(b);
    (a - b).abs() > (scene.tracing_scale(camera, a.min(b)) * world * R::of(8.0)).sqrt()
}
