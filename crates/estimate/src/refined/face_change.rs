//! A part of a line of the film where the visible surface goes from one face to another.

use field::{Real, Vector3};
use render::Scene;

use super::line_places::{FaceHit, Place};
use crate::crossing::is_grazing;
use crate::record::FilmLine;

/// A part of a line whose ends hit different faces.
#[derive(Clone, Copy, Debug)]
pub(super) struct FaceChange<R: Real> {
    /// The line, by its number.
    pub(super) line: usize,
    /// The parameter of the line and the hit at both ends.
    pub(super) ends: [(f64, FaceHit<R>); 2],
}

impl<R: Real> FaceChange<R> {
    /// The change between two places, if they hit different faces.
    pub(super) fn between(line: usize, a: &Place<R>, b: &Place<R>) -> Option<Self> {
        let (first, second) = (a.hit?, b.hit?);
        let ends = [(a.s, first), (b.s, second)];
        (first.face != second.face).then_some(FaceChange { line, ends })
    }

    /// The length of the part, in pixels.
    pub(super) fn width(&self) -> f64 {
        self.ends[1].0 - self.ends[0].0
    }

    /// The middle of the change, as a parameter of the line.
    pub(super) fn middle(&self) -> f64 {
        (self.ends[0].0 + self.ends[1].0) * 0.5
    }

    /// Whether the faces are at a grazing angle to the ray through the middle.
    pub(super) fn grazing(&self, scene: &Scene<'_, R>, lines: &[FilmLine]) -> [bool; 2] {
        let line = &lines[self.line];
        let d = R::Vec3::of(scene.cameras[line.camera].direction(line.at(self.middle()).u));
        self.ends.map(|(_, hit)| is_grazing::<R>(hit.gradient, d))
    }

    /// The place where the tangent planes of the two faces meet on the line, or the middle if they
    /// meet outside of the interval.
    pub(super) fn expected(&self, scene: &Scene<'_, R>, lines: &[FilmLine]) -> f64 {
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
