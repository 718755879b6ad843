//! Faces that a line may have missed between its places.

use field::Real;
use glam::DVec2;
use render::Scene;

use super::creases::{is_crease, project};
use super::face_change::FaceChange;
use super::line_places::{LinePlaces, Part, Place};
use super::neighbours::{Neighbours, meeting};
use crate::crossing::tolerance;
use crate::record::FilmLine;

/// The largest number of places of one line, for fields that have a new face everywhere.
const MAX_PLACES: usize = 64;

/// A face is not looked for this close to a known place, in tolerances.
const NEAR: f64 = 10.0;

/// The places (line, s) where lines beside those in `fresh` may have missed a face: the expected
/// middle of each part with one face, on the nearest lines along both axes that know other faces
/// there.
pub(super) fn unseen_faces<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    neighbours: &Neighbours,
    places: &LinePlaces<R>,
    fresh: &[usize],
) -> Vec<(usize, f64)> {
    let mut wanted = Vec::new();
    for &number in fresh {
        let line = &lines[number];
        for part in places.parts(number) {
            let ends = [0, 1].map(|end| End::of(scene, lines, number, &part, end));
            let middle = (ends[0].u + ends[1].u) * 0.5;
            for axis in 0..2 {
                for other in neighbours.beside(lines, line.pixel, axis, middle) {
                    let Some(s) = expected_middle(ends, line, &lines[other]) else { continue };
                    let Some(pair) = places.around(other, s) else { continue };
                    let unknown = |place: &Place<R>| {
                        let near = (place.s - s).abs() < NEAR * tolerance::<R>();
                        place.face() != Some(part.face) && !near
                    };
                    if pair.into_iter().all(unknown) && places.count(other) < MAX_PLACES {
                        wanted.push((other, s));
                    }
                }
            }
        }
    }
    wanted.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    wanted.dedup();
    wanted
}

/// An end of a part of a line.
#[derive(Clone, Copy, Debug)]
struct End {
    /// The film position.
    u: DVec2,
    /// The normal on the film of the curve that bounds the face there; `None` at the end of the
    /// line, or if it is not known.
    normal: Option<DVec2>,
}

impl End {
    /// The first (0) or the last (1) end of a part of the line `number`.
    fn of<R: Real>(
        scene: &Scene<'_, R>,
        lines: &[FilmLine],
        number: usize,
        part: &Part<'_, R>,
        end: usize,
    ) -> Self {
        let own = part.ends[end];
        let normal = part.around[end].and_then(|other| {
            let [a, b] = if end == 0 { [other, own] } else { [own, other] };
            a.silhouette.or_else(|| {
                let change = FaceChange::between(number, a, b)?;
                let [x, y] = project(scene, lines, &change).determinant.map(Real::to_double);
                is_crease(scene, lines, &change).then_some(DVec2::new(x, y))
            })
        });
        End { u: lines[number].at(own.s).u, normal }
    }

    /// Where the curve that bounds the face meets a line along the same axis.
    fn on(&self, other: &FilmLine) -> f64 {
        let straight = self.u[other.axis] - other.start[other.axis];
        let s = self.normal.map_or(straight, |normal| meeting(self.u, normal, other));
        if s.is_finite() { s.clamp(0.0, 1.0) } else { straight }
    }
}

/// The parameter of the middle of a face on another line, expected from the ends of a part of
/// `line` with this face.
fn expected_middle(ends: [End; 2], line: &FilmLine, other: &FilmLine) -> Option<f64> {
    let axis = line.axis;
    if other.axis != axis {
        let crosses = (ends[0].u[axis]..ends[1].u[axis]).contains(&other.start[axis]);
        return crosses.then(|| line.start[other.axis] - other.start[other.axis]);
    }
    let [from, to] = ends.map(|end| end.on(other));
    (from < to).then_some((from + to) * 0.5)
}
