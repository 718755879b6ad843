//! Pixels, and film positions in them.

use std::ops::Range;

use glam::DVec2;
use random::{Name, Stream};

const PIXEL_SAMPLES: Name = Name::new("positions in a pixel", 4);

/// A pixel of one of a scene's cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pixel {
    /// The index of the camera.
    pub camera: usize,
    /// The column, from 0 at the left.
    pub x: u32,
    /// The row, from 0 at the top.
    pub y: u32,
}

impl Pixel {
    /// The random numbers of this pixel: its part of a stream.
    pub fn part_of(&self, stream: Stream) -> Stream {
        let position = u64::from(self.y) << 32 | u64::from(self.x);
        stream.at(self.camera as u64).at(position)
    }

    /// The film position of the pixel's upper left corner, in pixels.
    pub fn corner(&self) -> DVec2 {
        DVec2::new(f64::from(self.x), f64::from(self.y))
    }
}

/// A position on the film of one camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The index of the camera.
    pub camera: usize,
    /// The film position, in pixels.
    pub u: DVec2,
}

/// Samples of every pixel, in the order of the pixels: the points number `range` of a Sobol
/// sequence in the pixel's unit square, scrambled by the stream and the pixel.
///
/// The points are those of Burley, "Practical Hash-based Owen Scrambling", Journal of Computer
/// Graphics Techniques 9(4), 2020.
pub fn pixel_samples(
    pixels: impl ExactSizeIterator<Item = Pixel>,
    range: &Range<u32>,
    stream: Stream,
) -> Vec<Sample> {
    let stream = stream.named(PIXEL_SAMPLES);
    let mut samples = Vec::with_capacity(pixels.len() * range.len());
    for pixel in pixels {
        let points = pixel.part_of(stream).sobol_points::<2>(range.clone());
        samples.extend(points.map(|point| {
            let u = pixel.corner() + DVec2::from(point);
            Sample { camera: pixel.camera, u }
        }));
    }
    samples
}
