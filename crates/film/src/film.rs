//! Images in linear RGB.

/// An image: linear RGB radiance, `f32`, rows top to bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// height × width pixels, row-major.
    pub pixels: Vec<[f32; 3]>,
}

impl Film {
    /// A black image.
    pub fn new(width: u32, height: u32) -> Self {
        Film { width, height, pixels: vec![[0.0; 3]; width as usize * height as usize] }
    }

    /// The pixel in column `x`, row `y`.
    pub fn at(&self, x: u32, y: u32) -> [f32; 3] {
        self.pixels[y as usize * self.width as usize + x as usize]
    }

    /// The column and row of the first pixel with a NaN or an infinity.
    pub fn first_non_finite(&self) -> Option<(u32, u32)> {
        let bad = self.pixels.iter().position(|p| p.iter().any(|v| !v.is_finite()))? as u32;
        Some((bad % self.width, bad / self.width))
    }

    /// The image at half the size, each pixel the mean of the 2 × 2 (at an odd border, fewer) that
    /// it covers.
    pub fn halved(&self) -> Film {
        self.downscaled(2)
    }

    /// The image at 1/`n` of the size, each pixel the mean of the n × n (at a border, fewer) that
    /// it covers.
    pub fn downscaled(&self, n: u32) -> Film {
        let (width, height) = (self.width.div_ceil(n), self.height.div_ceil(n));
        let mut out = Film::new(width, height);
        for y in 0..height {
            for x in 0..width {
                let mut sum = [0.0; 3];
                let mut count = 0.0;
                for v in (n * y)..(n * y + n).min(self.height) {
                    for u in (n * x)..(n * x + n).min(self.width) {
                        let p = self.at(u, v);
                        sum = std::array::from_fn(|c| sum[c] + p[c]);
                        count += 1.0;
                    }
                }
                out.pixels[y as usize * width as usize + x as usize] = sum.map(|s| s / count);
            }
        }
        out
    }
}

/// The sRGB transfer function (IEC 61966-2-1): linear radiance to display value; values above 1 go
/// on growing.
pub fn srgb_encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_encode`].
pub fn srgb_decode(display: f32) -> f32 {
    if display <= 0.040_45 { display / 12.92 } else { ((display + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn transfer_functions_invert() {
        for i in 0..=255 {
            let display = i as f32 / 255.0;
            assert_relative_eq!(srgb_encode(srgb_decode(display)), display, epsilon = 1e-6);
        }
    }

    #[test]
    fn halving_keeps_the_mean_and_handles_odd_sizes() {
        let film = Film { width: 3, height: 1, pixels: vec![[1.0; 3], [3.0; 3], [5.0; 3]] };
        let half = film.halved();
        assert_eq!((half.width, half.height), (2, 1));
        assert_eq!(half.pixels, vec![[2.0; 3], [5.0; 3]]);
    }
}
