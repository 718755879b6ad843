//! Films of another size.

use image::imageops::FilterType;
use image::{ImageBuffer, Rgb};

use crate::film::Film;

impl Film {
    /// The same image with `width` × `height` pixels, 1 or more each, by a triangle filter as wide
    /// as the larger of two neighbouring pixels.
    ///
    /// # Panics
    /// If the film has another number of pixels than its width times its height.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let values = self.pixels.as_flattened().to_vec();
        let buffer = ImageBuffer::<Rgb<f32>, _>::from_raw(self.width, self.height, values);
        let buffer = buffer.expect("width times height pixels");
        let small = image::imageops::resize(&buffer, width, height, FilterType::Triangle);
        Film { width, height, pixels: small.pixels().map(|pixel| pixel.0).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_and_doubles_keep_edges_in_their_places() {
        let edge = Film::grey(8, 2, (0..16).map(|i| if i % 8 < 4 { 0.0 } else { 1.0 }));
        let half = edge.resized(4, 1);
        assert_eq!((half.width, half.height), (4, 1));
        assert!(half.pixels[0][0] < 0.01 && half.pixels[3][0] > 0.99);
        assert!(half.pixels[1][0] < 0.5 && half.pixels[2][0] > 0.5);
        let twice = edge.resized(16, 4);
        assert!(twice.at(6, 1)[0] < 0.5 && twice.at(9, 1)[0] > 0.5);
        assert_eq!(edge.resized(8, 2), edge);
    }
}
