//! Searches for silhouettes along lines on the film.

use field::{Real, Vector3};
use render::Scene;
use trace::{RayFamily, Start, Tangency, tangencies};

use crate::crossing::tolerance;
use crate::record::FilmLine;

/// Searches, each with its start and its line.
pub(super) struct Searches<R> {
    starts: Vec<Start<R>>,
    origins: Vec<Origin>,
}

/// The line of a search.
#[derive(Clone, Copy, Debug)]
struct Origin {
    line: usize,
    /// The search may find silhouettes between these values of s.
    between: [f64; 2],
}

impl<R: Real> Searches<R> {
    pub(super) fn new() -> Self {
        Searches { starts: Vec::new(), origins: Vec::new() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.starts.is_empty()
    }

    /// Adds a search along `line`. It may find silhouettes for s in `between`, which replaces
    /// `start.range`.
    pub(super) fn push(&mut self, line: usize, between: [f64; 2], start: Start<R>) {
        self.starts.push(Start { range: between.map(R::of), ..start });
        self.origins.push(Origin { line, between });
    }
}

/// The rays of searches: one film line each.
struct SearchRays<'a, R: Real> {
    scene: &'a Scene<'a, R>,
    lines: Vec<FilmLine>,
}

impl<R: Real> RayFamily<R> for SearchRays<'_, R> {
    fn origin(&self, index: usize) -> R::Vec3 {
        R::Vec3::of(self.scene.cameras[self.lines[index].camera].eye)
    }
    fn direction(&self, index: usize, s: R) -> (R::Vec3, R::Vec3) {
        let line = &self.lines[index];
        let sample = line.at(s.to_double());
        let (d, du) = self.scene.cameras[sample.camera].direction_du(sample.u);
        (R::Vec3::of(d), R::Vec3::of(du[line.axis]))
    }
}

/// A crossing of a line with a silhouette that may be hidden.
#[derive(Clone, Copy, Debug)]
pub(super) struct LineTangency<R: Real> {
    pub(super) line: usize,
    pub(super) tangency: Tangency<R>,
}

/// The known crossings of lines with silhouettes, visible or hidden.
pub(super) struct KnownTangencies<R: Real> {
    all: Vec<LineTangency<R>>,
    of_line: Vec<Vec<usize>>,
}

/// The largest number of silhouettes of one line. On a surface without inner points, searches would
/// find new ones without end.
const MAX_TANGENCIES: usize = 64;

/// The largest distance on the film of two silhouettes at the same position, in tolerances.
const SAME_PLACE: f64 = 10.0;

/// Two silhouettes of one line at the same film position are the same if
/// their depths differ by less than this, in [`Scene::tracing_scale`]. At 0.005 silhouettes of the
/// smallest ball of the suite count twice: its error is 4.6 times as large. At 0.08 nothing
/// changes; parts of a solid this far apart in depth would count as one.
pub(super) const SAME_DEPTH: f64 = 0.02;

/// Whether two silhouettes of one line are the same: `along` is the difference of their s, `depth`
/// that of their depths, which is less than `same` for the same silhouette.
pub(super) fn is_same<R: Real>(along: f64, depth: R, same: R) -> bool {
    along.abs() < SAME_PLACE * tolerance::<R>() && depth.abs() < same
}

/// The width of a minimum of f along a ray that searches assume at first, in bounding radii; the
/// width of a pixel if that is less. At 0.005: evaluations 1.014. At 0.08: the largest bias of the
/// suite is 0.020 instead of 0.017.
const FIRST_REACH: f64 = 0.02;

/// The width of a minimum of f that searches assume at first at the distance `t`, in world units.
pub(super) fn first_reach<R: Real>(scene: &Scene<'_, R>, camera: usize, t: R) -> R {
    let pixel = R::of(scene.cameras[camera].pixel_angle()) * t;
    (scene.radius() * R::of(FIRST_REACH)).min(pixel)
}

impl<R: Real> KnownTangencies<R> {
    pub(super) fn new(lines: usize) -> Self {
        KnownTangencies { all: Vec::new(), of_line: vec![Vec::new(); lines] }
    }

    /// The silhouettes of a line.
    pub(super) fn of(&self, line: usize) -> impl Iterator<Item = &Tangency<R>> {
        self.of_line[line].iter().map(|&i| &self.all[i].tangency)
    }

    /// The number of silhouettes of all lines.
    pub(super) fn count(&self) -> usize {
        self.all.len()
    }

    /// The silhouettes of all lines, without the first `known`.
    pub(super) fn since(&self, known: usize) -> &[LineTangency<R>] {
        &self.all[known..]
    }

    /// Runs searches, and adds the silhouettes that are new.
    pub(super) fn search(
        &mut self,
        scene: &Scene<'_, R>,
        lines: &[FilmLine],
        searches: &Searches<R>,
    ) {
        let Searches { starts, origins } = searches;
        let rays = SearchRays { scene, lines: origins.iter().map(|o| lines[o.line]).collect() };
        let found = tangencies(scene.field, &rays, starts, R::of(tolerance::<R>()));
        for (tangency, origin) in found.into_iter().zip(origins) {
            let Some(tangency) = tangency else { continue };
            let s = tangency.s.to_double();
            if s >= origin.between[0] && s <= origin.between[1] && (0.0..1.0).contains(&s) {
                let camera = lines[origin.line].camera;
                let same = scene.tracing_scale(camera, tangency.t) * R::of(SAME_DEPTH);
                self.add(LineTangency { line: origin.line, tangency }, same);
            }
        }
    }

    /// Adds a silhouette unless it is known: one of the same line, at the same s, with a depth
    /// within `same` of its own.
    fn add(&mut self, found: LineTangency<R>, same: R) {
        let near = |other: &Tangency<R>| {
            let along = (other.s - found.tangency.s).to_double();
            is_same(along, other.t - found.tangency.t, same)
        };
        let of_line = &self.of_line[found.line];
        if of_line.len() < MAX_TANGENCIES && !self.of(found.line).any(near) {
            self.of_line[found.line].push(self.all.len());
            self.all.push(found);
        }
    }
}
