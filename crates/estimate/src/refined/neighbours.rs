//! Searches that follow a silhouette from one line of a pixel to the lines beside it.

use std::ops::Range;

use field::{Real, Vector3};
use glam::DVec2;
use render::Scene;
use rustc_hash::FxHashMap;
use trace::{Start, Tangency};

use super::search::{KnownTangencies, LineTangency, Searches, first_reach};
use crate::crossing::tolerance;
use crate::record::FilmLine;

/// The order of the lines of each pixel along each axis.
pub(super) struct Neighbours {
    /// The numbers of the lines, sorted by pixel, axis and offset.
    order: Vec<usize>,
    /// For a pixel and an axis, the range of its lines in `order`.
    groups: FxHashMap<(u32, usize), Range<usize>>,
}

/// A silhouette this close to the expected position, as a fraction of the distance over which it
/// was followed, is the expected one. At 0.25 and 1: evaluations 1.003 and 0.998.
const MATCH: f64 = 0.5;

/// The coordinate of a line across its axis, in pixels.
fn offset(line: &FilmLine) -> f64 {
    line.start[1 - line.axis]
}

impl Neighbours {
    pub(super) fn new(lines: &[FilmLine]) -> Self {
        let mut order: Vec<usize> = (0..lines.len()).collect();
        let group = |i: &usize| (lines[*i].pixel, lines[*i].axis);
        order.sort_by(|a, b| {
            group(a).cmp(&group(b)).then(offset(&lines[*a]).total_cmp(&offset(&lines[*b])))
        });
        let mut groups = FxHashMap::default();
        let mut from = 0;
        for chunk in order.chunk_by(|a, b| group(a) == group(b)) {
            groups.insert(group(&chunk[0]), from..from + chunk.len());
            from += chunk.len();
        }
        Neighbours { order, groups }
    }

    /// The nearest lines along `axis` on both sides of the film position `u`, without lines through
    /// `u`.
    pub(super) fn beside<'a>(
        &'a self,
        lines: &'a [FilmLine],
        pixel: u32,
        axis: usize,
        u: DVec2,
    ) -> impl Iterator<Item = usize> + 'a {
        let group = self.groups.get(&(pixel, axis));
        let group = group.map_or(&[][..], |range| &self.order[range.clone()]);
        let across = u[1 - axis];
        let before = group.partition_point(|&l| offset(&lines[l]) < across);
        let after = group.partition_point(|&l| offset(&lines[l]) <= across);
        [before.checked_sub(1), Some(after)]
            .into_iter()
            .flatten()
            .filter_map(|i| group.get(i).copied())
    }

    /// Searches for the silhouettes `found` on the lines beside their own, where they are not yet
    /// known.
    pub(super) fn searches<R: Real>(
        &self,
        scene: &Scene<'_, R>,
        lines: &[FilmLine],
        known: &KnownTangencies<R>,
        found: &[LineTangency<R>],
    ) -> Searches<R> {
        let mut searches = Searches::new();
        let room = [-2.0 * tolerance::<R>(), 1.0 + 2.0 * tolerance::<R>()];
        for LineTangency { line, tangency } in found {
            let line = &lines[*line];
            let sample = line.at(tangency.s.to_double());
            let (_, du) = scene.cameras[sample.camera].direction_du(sample.u);
            let film_gradient =
                DVec2::from(du.map(|du| tangency.gradient.dot(R::Vec3::of(du)).to_double()));
            for axis in 0..2 {
                for other in self.beside(lines, line.pixel, axis, sample.u) {
                    let Some(expected) = expected_at(sample.u, film_gradient, &lines[other]) else {
                        continue;
                    };
                    let leaves = film_gradient[axis] > 0.0;
                    let same = |t: &Tangency<R>| {
                        (t.slope > R::zero()) == leaves
                            && (t.s.to_double() - expected.s).abs() < expected.reach::<R>()
                    };
                    if !known.of(other).any(same) {
                        let start = Start {
                            s: R::of(expected.s),
                            t: tangency.t,
                            range: [R::zero(); 2],
                            reach: first_reach(scene, line.camera, tangency.t),
                            steepest: R::one(),
                        };
                        searches.push(other, room, start);
                    }
                }
            }
        }
        searches
    }
}

/// The expected crossing of a silhouette with another line.
struct Expected {
    /// The parameter of the line.
    s: f64,
    /// The distance over which the silhouette was followed, in pixels.
    followed: f64,
}

impl Expected {
    /// A silhouette this close to the expected position, in pixels, is the expected one.
    fn reach<R: Real>(&self) -> f64 {
        MATCH * self.followed + 10.0 * tolerance::<R>()
    }
}

/// The intersection of the tangent of a silhouette at `u` with another line, if it is inside the
/// pixel of that line.
fn expected_at(u: DVec2, film_gradient: DVec2, other: &FilmLine) -> Option<Expected> {
    let s = meeting(u, film_gradient, other);
    let followed = (other.at(s).u - u).length();
    (0.0..1.0).contains(&s).then_some(Expected { s, followed })
}

/// The parameter at which a line meets the line through the film position `u` with this normal.
pub(super) fn meeting(u: DVec2, normal: DVec2, line: &FilmLine) -> f64 {
    let (axis, start) = (line.axis, line.start);
    let away = start[1 - axis] - u[1 - axis];
    u[axis] - start[axis] - away * normal[1 - axis] / normal[axis]
}
