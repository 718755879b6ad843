//! Random lines through a pixel, and their parts inside it.

use glam::DVec2;
use random::{Name, Stream};
use render::Pixel;

/// The part of a line inside a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chord {
    /// The film positions of the ends, on the border of the pixel.
    pub(crate) ends: [DVec2; 2],
    /// The weight of the chord, in pixels: ∮ g dl ≈ Σ measure · g over the crossings of all chords
    /// with the curve.
    pub(crate) measure: f64,
}

const LINES: Name = Name::other("lines of the Crofton formula");

/// Up to `count` chords of a pixel, from lines with uniform angles and offsets.
///
/// Crofton's formula: the integral of g along a curve is half the integral over all lines, in dp
/// dφ, of the sum of g over the crossings of the line with the curve. A line of angle φ meets the
/// unit square if its offset p lies in an interval of length |cos φ| + |sin φ|.
pub(crate) fn chords(pixel: &Pixel, count: u32, stream: Stream) -> impl Iterator<Item = Chord> {
    let centre = pixel.corner() + 0.5;
    let stream = pixel.part_of(stream.named(LINES));
    (0..count).filter_map(move |i| {
        let [angle, offset] = stream.sobol(i);
        let (sin, cos) = (std::f64::consts::PI * angle).sin_cos();
        let (along, across) = (DVec2::new(cos, sin), DVec2::new(-sin, cos));
        let width = cos.abs() + sin.abs();
        let middle = across * ((offset - 0.5) * width);
        let [from, to] = clip(middle, along)?;
        let measure = 0.5 * std::f64::consts::PI * width / f64::from(count);
        Some(Chord { ends: [from, to].map(|s| centre + middle + along * s), measure })
    })
}

/// The range of s in which middle + s · along lies in the unit square about the origin.
fn clip(middle: DVec2, along: DVec2) -> Option<[f64; 2]> {
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in (0..2).filter(|&axis| along[axis].abs() > f64::EPSILON) {
        let ends = [-0.5, 0.5].map(|side| (side - middle[axis]) / along[axis]);
        from = from.max(ends[0].min(ends[1]));
        to = to.min(ends[0].max(ends[1]));
    }
    (from < to).then_some([from, to])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The length of a circle of radius 0.3 inside the pixel, from its crossings with chords.
    #[test]
    fn crossings_give_the_length_of_a_circle() {
        let (pixel, count) = (Pixel { camera: 0, x: 3, y: 5 }, 4096);
        let centre = DVec2::new(3.4, 5.55);
        let length: f64 = chords(&pixel, count, Stream::of_seed(7))
            .map(|chord| {
                let [a, b] = chord.ends;
                let along = (b - a).normalize();
                let nearest = a + along * (centre - a).dot(along);
                let half = 0.3f64.powi(2) - (centre - nearest).length_squared();
                if half > 0.0 { 2.0 * chord.measure } else { 0.0 }
            })
            .sum();
        let expected = std::f64::consts::TAU * 0.3;
        assert!((length - expected).abs() < 0.02 * expected, "{length} against {expected}");
    }
}
