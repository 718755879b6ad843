//! Silhouettes followed from one line of a pixel to those beside it.

use std::ops::Range;

use field::{Real, Vector3};
use glam::DVec2;
use rustc_hash::FxHashMap;

use super::Setup;
use super::lines::{Found, Known, Line, Searches, least_reach, tolerance};

/// Which lines of a pixel lie side by side.
pub(super) struct Neighbours {
    /// Lines by pixel, axis and offset.
    order: Vec<usize>,
    /// The part of `order` of a pixel and an axis.
    groups: FxHashMap<(u32, usize), Range<usize>>,
}

/// A silhouette that was expected on a line and found this far off, in parts of the way that it was
/// followed, is the one.
const MATCH: f64 = 0.5;

fn offset(line: &Line) -> f64 {
    line.start[1 - line.axis]
}

impl Neighbours {
    pub(super) fn new(lines: &[Line]) -> Self {
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

    /// The lines next to a place of the film on both sides, along an axis, without those through
    /// it.
    fn beside<'a>(
        &'a self,
        lines: &'a [Line],
        pixel: u32,
        axis: usize,
        u: DVec2,
    ) -> impl Iterator<Item = usize> + 'a {
        let group =
            self.groups.get(&(pixel, axis)).map_or(&[][..], |range| &self.order[range.clone()]);
        let across = u[1 - axis];
        let before = group.partition_point(|&l| offset(&lines[l]) < across);
        let after = group.partition_point(|&l| offset(&lines[l]) <= across);
        [before.checked_sub(1), Some(after)]
            .into_iter()
            .flatten()
            .filter_map(|i| group.get(i).copied())
    }

    /// Searches for what was found on one line on the lines beside it, where it is not known there.
    pub(super) fn searches<R: Real>(
        &self,
        setup: &Setup<'_, R>,
        lines: &[Line],
        known: &Known<R>,
        found: &[Found<R>],
    ) -> Searches<R> {
        let mut searches = Searches::new();
        let room = [-2.0 * tolerance::<R>(), 1.0 + 2.0 * tolerance::<R>()];
        for Found { line, tangency } in found {
            let line = &lines[*line];
            let sample = line.at(tangency.s.to_double());
            let (_, du) = setup.cameras[sample.camera].direction_du(sample.u);
            let rise = DVec2::from(du.map(|du| tangency.gradient.dot(R::Vec3::of(du)).to_double()));
            for axis in 0..2 {
                for other in self.beside(lines, line.pixel, axis, sample.u) {
                    let Line { start, .. } = lines[other];
                    // The tangent of the silhouette meets the other line here.
                    let away = start[1 - axis] - sample.u[1 - axis];
                    let along = -away * rise[1 - axis] / rise[axis];
                    let s = sample.u[axis] + along - start[axis];
                    if !(0.0..1.0).contains(&s) {
                        continue;
                    }
                    let reach = MATCH * away.hypot(along) + 10.0 * tolerance::<R>();
                    let leaves = rise[axis] > 0.0;
                    let same = |t: &trace::Tangency<R>| {
                        (t.slope > R::zero()) == leaves && (t.s.to_double() - s).abs() < reach
                    };
                    if !known.of(other).any(same) {
                        let least = least_reach(setup, line.camera, tangency.t);
                        searches.push(other, s, tangency.t, room, least, 1.0);
                    }
                }
            }
        }
        searches
    }
}
