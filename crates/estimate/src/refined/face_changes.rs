//! Places on lines of the film where the visible surface goes from one face to another.

use field::{Real, Vector3};
use render::{InvalidField, Scene};

use super::line_places::{FaceHit, LinePlaces, Place, trace};
use crate::film_line::{Crossing, FilmLine, Rim, tolerance};
use record::Record;

/// A part of a line whose ends hit different faces.
#[derive(Clone, Copy, Debug)]
pub(super) struct FaceChange<R: Real> {
    /// The line, by its number.
    pub(super) line: usize,
    /// The parameter of the line and the hit at both ends.
    pub(super) ends: [(f64, FaceHit<R>); 2],
}

/// The largest number of rounds. Each round divides an interval in two or three parts; every second
/// one halves it.
const ROUNDS: u32 = 28;

/// The largest number of intervals per line, for fields that have a new face everywhere.
const MAX_INTERVALS: usize = 16;

impl<R: Real> FaceChange<R> {
    /// The change between two places, if they hit different faces.
    fn between(line: usize, a: &Place<R>, b: &Place<R>) -> Option<Self> {
        let (first, second) = (a.hit?, b.hit?);
        let ends = [(a.s, first), (b.s, second)];
        (first.face != second.face).then_some(FaceChange { line, ends })
    }

    fn width(&self) -> f64 {
        self.ends[1].0 - self.ends[0].0
    }

    /// The middle of the change, as a parameter of the line.
    pub(super) fn middle(&self) -> f64 {
        (self.ends[0].0 + self.ends[1].0) * 0.5
    }

    /// The place where the tangent planes of the two faces meet on the line, or the middle if they
    /// meet outside of the interval.
    fn expected(&self, scene: &Scene<'_, R>, lines: &[FilmLine]) -> f64 {
        let line = &lines[self.line];
        let camera = &scene.cameras[line.camera];
        let eye = R::Vec3::of(camera.eye);
        let height = self.ends.map(|(_, hit)| hit.gradient.dot(hit.x - eye));
        // The difference of the distances of the planes along the ray at s.
        let gap = |s: f64| {
            let d = R::Vec3::of(camera.direction(line.at(s).u));
            let [a, b] = [0, 1].map(|end| height[end] / self.ends[end].1.gradient.dot(d));
            (a - b).to_double()
        };
        let [mut from, mut to] = self.ends.map(|(s, _)| s);
        let (mut low, mut high) = (gap(from), gap(to));
        let middle = (from + to) * 0.5;
        if low * high >= 0.0 || !(low * high).is_finite() {
            return middle;
        }
        let mut s = middle;
        for _ in 0..8 {
            s = from + (to - from) * (low / (low - high));
            let here = gap(s);
            if here * low > 0.0 {
                (from, low) = (s, here);
            } else {
                (to, high) = (s, here);
            }
        }
        s
    }
}

/// Finds the places where lines go from face to face between silhouettes. Each result is two
/// tolerances wide.
///
/// It can miss two changes between the same two faces that lie between all places of
/// [`LinePlaces::new`]. (To look for a face on the lines beside the one that has met it changes no
/// error of the families, with 1.5 % more evaluations.)
///
/// `crossings` are sorted by line, and along each line by s. `inner` has one more place per line.
pub(super) fn face_changes<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    inner: &[f64],
    crossings: &[Crossing<R>],
    record: &mut Record<R>,
) -> Result<Vec<FaceChange<R>>, InvalidField> {
    let places = LinePlaces::new(scene, lines, inner, crossings, record)?;
    let mut found = at_rims(scene, crossings, &places);
    let pairs = (0..lines.len()).flat_map(|line| places.pairs(line).map(move |pair| (line, pair)));
    let mut open: Vec<FaceChange<R>> =
        pairs.filter_map(|(line, [a, b])| FaceChange::between(line, a, b)).collect();
    let done = 2.0 * tolerance::<R>();
    for round in 0..ROUNDS {
        open.retain(|interval| {
            let narrow = interval.width() <= 1.01 * done;
            if narrow {
                found.push(*interval);
            }
            !narrow
        });
        if open.is_empty() {
            break;
        }
        open = divided(scene, lines, &open, round % 2 == 0, record)?;
    }
    Ok(found)
}

/// The changes between smooth silhouettes and the places beside them, inside the solid.
///
/// A face that is narrower than that between its silhouette and another face is in no ray. Where
/// the two curves meet, they have a common tangent, so this is a large part of their last pixel.
fn at_rims<R: Real>(
    scene: &Scene<'_, R>,
    crossings: &[Crossing<R>],
    places: &LinePlaces<R>,
) -> Vec<FaceChange<R>> {
    let smooth: Vec<&Crossing<R>> =
        crossings.iter().filter(|crossing| !crossing.rim.edge).collect();
    let x: Vec<R::Vec3> = smooth.iter().map(|crossing| crossing.rim.x).collect();
    let mut face = vec![0; x.len()];
    scene.field.faces(&x, &mut face);
    let change = |(crossing, face): (&&Crossing<R>, u32)| {
        let place = places.inside(crossing)?;
        let Rim { t, x, gradient, radiance, .. } = crossing.rim;
        let rim = Place::new(crossing.s, Some(FaceHit { face, t, x, gradient, radiance }));
        let [a, b] = if crossing.leaves { [place, &rim] } else { [&rim, place] };
        FaceChange::between(crossing.line, a, b)
    };
    smooth.iter().zip(face).filter_map(change).collect()
}

/// The parts of intervals that have a change: around the expected place, or halves.
fn divided<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    open: &[FaceChange<R>],
    expected: bool,
    record: &mut Record<R>,
) -> Result<Vec<FaceChange<R>>, InvalidField> {
    let reach = tolerance::<R>();
    let wanted: Vec<(usize, f64)> = open
        .iter()
        .flat_map(|interval| {
            let [from, to] = interval.ends.map(|(s, _)| s);
            let at = if expected { interval.expected(scene, lines) } else { (from + to) * 0.5 };
            [(at - reach).max(from), (at + reach).min(to)].map(|s| (interval.line, s))
        })
        .collect();
    let places = trace(scene, lines, &wanted, record)?;
    let mut of_line = vec![0; lines.len()];
    let mut parts = Vec::new();
    for (interval, inner) in open.iter().zip(places.chunks_exact(2)) {
        let [first, last] = interval.ends.map(|(s, hit)| Place::new(s, Some(hit)));
        for pair in [[&first, &inner[0]], [&inner[0], &inner[1]], [&inner[1], &last]] {
            let part = FaceChange::between(interval.line, pair[0], pair[1]);
            if let Some(part) = part.filter(|_| of_line[interval.line] < MAX_INTERVALS) {
                of_line[interval.line] += 1;
                parts.push(part);
            }
        }
    }
    Ok(parts)
}
