//! Probes of lines: the depths of surfaces along a line, and the starts of searches.

use field::Real;
use render::{InvalidField, Sample, Scene};
use trace::Start;

use super::search::{Searches, first_reach};
use super::visibility::VisibleCrossing;
use crate::crossing::tolerance;
use crate::record::FilmLine;
use crate::silhouette_margin::SILHOUETTE_COSINE;

/// The depth of the surface at one place of a line: from a ray, or beside a crossing.
#[derive(Clone, Copy, Debug)]
struct Probe<R> {
    s: f64,
    /// The depth of the surface, in world units; infinite if there is none.
    depth: R,
    /// The distance of the closest approach along the ray, in world units.
    nearest: R,
    /// The tangent of the angle by which the ray clears the surface there; infinite without a
    /// closest approach.
    clearance: R,
    kind: ProbeKind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ProbeKind {
    /// A ray.
    Ray,
    /// The side of a crossing with smaller s; the next probe is its other side.
    NearSide,
    /// The side of a crossing with larger s.
    FarSide,
}

/// The probes of every line, in order.
pub(super) struct Probes<R> {
    of_line: Vec<Vec<Probe<R>>>,
    /// The number of traced rays.
    pub(super) rays: u64,
}

/// The largest number of probes of one line, for the same reason as `MAX_TANGENCIES`.
const MAX_PROBES: usize = 256;

/// A search starts at a closest approach whose clearance, in pixels, is less than this multiple of
/// the distance on the film to the next probe, which is at most 1. With 1, it would find all
/// silhouettes if f is a distance; the rest is a margin for other fields.
const MARGIN: f64 = 2.0;

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
        // Searches start at closest approaches, which may lie outside the ball around the solid.
        let scene = &scene.clipped_to_bounds().within_reach(MARGIN);
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

    /// Searches that start at the closest approaches and at the grazing hits of the rays at
    /// `places`.
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
            // No silhouette is closer than this, in pixels, if f is a distance.
            let pixel_angle = R::of(scene.cameras[camera].pixel_angle());
            let away = (probe.clearance / pixel_angle).to_double();
            if away < MARGIN * (s - before).max(after - s) {
                let least = first_reach(scene, camera, probe.nearest);
                let reach = (probe.clearance * probe.nearest).max(least);
                searches.push(line, between, start(probe.nearest, reach, 1.0));
            }
            // The rays beside a gap between two surfaces hit these at grazing angles.
            if probe.depth.is_finite() {
                let reach = first_reach(scene, camera, probe.depth);
                searches.push(line, between, start(probe.depth, reach, SILHOUETTE_COSINE));
            }
        }
        searches
    }

    /// Inserts a probe after all probes of the line with the same or a smaller s.
    fn insert(&mut self, line: usize, probe: Probe<R>) {
        let of_line = &mut self.of_line[line];
        let at = of_line.partition_point(|p| p.s <= probe.s);
        of_line.insert(at, probe);
    }

    /// Adds the depths on both sides of a crossing.
    pub(super) fn add_sides(&mut self, visible: &VisibleCrossing<R>) {
        let VisibleCrossing { crossing, inside, outside } = visible;
        let (first, second) =
            if crossing.leaves { (*inside, *outside) } else { (*outside, *inside) };
        for (depth, kind) in [(first, ProbeKind::NearSide), (second, ProbeKind::FarSide)] {
            let (nearest, clearance) = (R::zero(), R::infinity());
            self.insert(crossing.line, Probe { s: crossing.s, depth, nearest, clearance, kind });
        }
    }

    /// The middles of the intervals whose ends hit different surfaces without a crossing between
    /// them.
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

/// Whether two depths at a distance of `width` pixels belong to different surfaces: only one of
/// them is finite, or they differ by more than twice as much as those of a ball as large as the
/// tracing scale, over this distance h inwards from its silhouette: 2 √(2 r h).
fn jumps<R: Real>(scene: &Scene<'_, R>, camera: usize, [a, b]: [R; 2], width: f64) -> bool {
    if a.is_infinite() || b.is_infinite() {
        return a != b;
    }
    let world = R::of(width * scene.cameras[camera].pixel_angle()) * a.min(b);
    (a - b).abs() > (scene.tracing_scale(camera, a.min(b)) * world * R::of(8.0)).sqrt()
}
