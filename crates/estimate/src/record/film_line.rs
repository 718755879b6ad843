//! Lines on the film.

use glam::DVec2;
use render::Sample;

/// A line across a pixel, parallel to a film axis. Its parameter s runs from 0 at one border of the
/// pixel to 1 at the other, in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmLine {
    /// The pixel, by its number in the batch.
    pub pixel: u32,
    /// The camera, by its number in the scene.
    pub camera: usize,
    /// The film axis that the line is parallel to: 0 for x, 1 for y.
    pub axis: usize,
    /// The film position at s = 0.
    pub start: DVec2,
    /// The weight of the line in the mean over the pixel's lines along this axis.
    pub weight: f64,
}

impl FilmLine {
    /// The film sample at s.
    pub fn at(&self, s: f64) -> Sample {
        let mut u = self.start;
        u[self.axis] += s;
        Sample { camera: self.camera, u }
    }
}

/// The end of a segment of a line: a crossing with a silhouette or a crease.
#[derive(Clone, Copy, Debug)]
pub struct SegmentEnd {
    /// The line, by its number.
    pub line: usize,
    /// The parameter of the line.
    pub s: f64,
    /// Whether the derivative of the hit point grows as 1/√distance towards it: before it and after
    /// it, in the direction of growing s.
    pub steep: [bool; 2],
}
