//! The image type.

use crate::blocks::block_row;

/// An image of linear RGB radiance in `f32`, rows from top to bottom.
///
/// The methods expect height × width pixels. The fields are public, so the caller keeps this true.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// height × width pixels, row by row: pixel (x, y) has the index y · width + x.
    pub pixels: Vec<[f32; 3]>,
}

impl Film {
    /// A black image.
    pub fn new(width: u32, height: u32) -> Self {
        Film { width, height, pixels: vec![[0.0; 3]; width as usize * height as usize] }
    }

    /// A grey image: each of `values`, height × width of them, row by row, in all three channels.
    pub fn grey(width: u32, height: u32, values: impl IntoIterator<Item = f32>) -> Self {
        Film { width, height, pixels: values.into_iter().map(|value| [value; 3]).collect() }
    }

    /// The pixel in column `x` and row `y`, both counted from 0 at the top left corner.
    ///
    /// # Panics
    /// If the pixel's index lies beyond the end of `pixels`. A column beyond the width is not
    /// detected otherwise.
    pub fn at(&self, x: u32, y: u32) -> [f32; 3] {
        self.pixels[y as usize * self.width as usize + x as usize]
    }

    /// The column and row of the first pixel that holds a NaN or an infinity, in storage order.
    /// `None` if all values are finite.
    pub fn first_non_finite(&self) -> Option<(u32, u32)> {
        let index = self.pixels.iter().position(|p| p.iter().any(|v| !v.is_finite()))? as u32;
        Some((index % self.width, index / self.width))
    }

    /// The image at 1/`n` of the size, rounded up.
    ///
    /// Each pixel is the mean of the n × n pixels that it covers. At the right and the lower
    /// border it covers fewer if the size is no multiple of `n`.
    ///
    /// # Panics
    /// If `n` is 0.
    pub fn downscaled(&self, n: u32) -> Film {
        let (size, height) = ([self.width, self.height], self.height.div_ceil(n));
        let width = self.width as usize;
        let row = |y: u32, out: &mut [[f32; 3]]| {
            out.copy_from_slice(&self.pixels[y as usize * width..][..width]);
        };
        let pixels = (0..height).flat_map(|y| block_row(size, n, y, row));
        Film { width: self.width.div_ceil(n), height, pixels: pixels.collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_keeps_the_mean_and_handles_odd_sizes() {
        let film = Film { width: 3, height: 1, pixels: vec![[1.0; 3], [3.0; 3], [5.0; 3]] };
        let half = film.downscaled(2);
        assert_eq!((half.width, half.height), (2, 1));
        assert_eq!(half.pixels, vec![[2.0; 3], [5.0; 3]]);
    }
}
