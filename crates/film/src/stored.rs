//! Images as their files store them, which are read pixel by pixel.

use image::{ColorType, DynamicImage};

use crate::film::Film;
use crate::srgb::{srgb_decode, srgb_encode};

/// An image as its file stores it. Its pixels are decoded one by one.
///
/// Samples of 8 bits stay bytes: a pixel of a photograph takes 3 bytes in place of the 12 of a
/// [`Film`]. So a reduced or undistorted copy is made without a film of the full size.
#[derive(Clone, Debug)]
pub struct StoredImage {
    width: u32,
    height: u32,
    samples: Samples,
}

#[derive(Clone, Debug)]
enum Samples {
    /// sRGB samples of 8 bits.
    Bytes { bytes: Vec<u8>, color: ColorType, tables: Box<Tables> },
    /// Linear pixels and an alpha channel.
    Linear(Film, Option<Vec<f32>>),
}

/// The values of all bytes.
#[derive(Clone, Debug)]
struct Tables {
    /// Linear radiance.
    linear: [f32; 256],
    /// The display value of that.
    display: [f32; 256],
}

impl Tables {
    /// Decodes consecutive pixels.
    fn decode(&self, bytes: &[u8], color: ColorType, pixels: &mut [[f32; 3]]) {
        let of = |byte: u8| self.linear[usize::from(byte)];
        match (color.has_color(), color.has_alpha()) {
            (true, false) => {
                let (bytes, _) = bytes.as_chunks();
                pixels
                    .iter_mut()
                    .zip(bytes)
                    .for_each(|(out, [r, g, b])| *out = [*r, *g, *b].map(of));
            }
            (true, true) => {
                let (bytes, _) = bytes.as_chunks();
                let all = pixels.iter_mut().zip(bytes);
                all.for_each(|(out, [r, g, b, _])| *out = [*r, *g, *b].map(of));
            }
            (false, has_alpha) => {
                let bytes = bytes.iter().step_by(1 + usize::from(has_alpha));
                pixels.iter_mut().zip(bytes).for_each(|(out, grey)| *out = [of(*grey); 3]);
            }
        }
    }
}

/// The number that a byte stands for, from 0 to 1.
fn of_byte(byte: u8) -> f32 {
    f32::from(byte) / 255.0
}

impl StoredImage {
    /// The image that a decoder returned. Floats are taken as linear, and other samples as sRGB.
    pub(crate) fn of_decoded(image: DynamicImage) -> Self {
        let (width, height, color) = (image.width(), image.height(), image.color());
        if color.bytes_per_pixel() == color.channel_count() {
            let linear: [f32; 256] =
                std::array::from_fn(|v| srgb_decode(of_byte(v.to_le_bytes()[0])));
            let tables = Box::new(Tables { linear, display: linear.map(srgb_encode) });
            let samples = Samples::Bytes { bytes: image.into_bytes(), color, tables };
            return StoredImage { width, height, samples };
        }
        let is_linear = matches!(color, ColorType::Rgb32F | ColorType::Rgba32F);
        let decode = |v: f32| if is_linear { v } else { srgb_decode(v) };
        let rgba = color.has_alpha().then(|| image.to_rgba32f());
        let alpha = rgba.map(|rgba| rgba.pixels().map(|p| p.0[3]).collect());
        let pixels = image.into_rgb32f().pixels().map(|p| p.0.map(decode)).collect();
        StoredImage::of_film(Film { width, height, pixels }, alpha)
    }

    /// A linear image, and its alpha channel if it has one.
    pub(crate) fn of_film(film: Film, alpha: Option<Vec<f32>>) -> Self {
        let (width, height) = (film.width, film.height);
        StoredImage { width, height, samples: Samples::Linear(film, alpha) }
    }

    /// The width and the height in pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// The linear RGB of the pixel in column `x` and row `y`, both counted from 0 at the top left
    /// corner. The alpha channel is not multiplied into it.
    ///
    /// # Panics
    /// If the pixel's index lies beyond the end of the image.
    #[inline(always)]
    pub fn at(&self, x: u32, y: u32) -> [f32; 3] {
        match &self.samples {
            Samples::Bytes { bytes, color, tables } => {
                let pixel = self.samples_at(bytes, *color, x, y);
                let decode = |v: u8| tables.linear[usize::from(v)];
                match *pixel {
                    [r, g, b] | [r, g, b, _] => [decode(r), decode(g), decode(b)],
                    _ => [decode(pixel[0]); 3],
                }
            }
            Samples::Linear(film, _) => film.at(x, y),
        }
    }

    /// Writes row `y` of the image to `row`, in linear RGB: the values of [`at`](Self::at).
    ///
    /// # Panics
    /// If there is no such row, or `row` has another length than the image's width.
    pub fn write_row(&self, y: u32, row: &mut [[f32; 3]]) {
        assert_eq!(row.len(), self.width as usize, "one pixel for each column");
        let first = self.index(0, y);
        match &self.samples {
            Samples::Bytes { bytes, color, tables } => {
                let channels = usize::from(color.channel_count());
                let bytes = &bytes[first * channels..][..row.len() * channels];
                tables.decode(bytes, *color, row);
            }
            Samples::Linear(film, _) => row.copy_from_slice(&film.pixels[first..][..row.len()]),
        }
    }

    /// The display value of the first channel of a pixel: that of a mask, for example.
    ///
    /// # Panics
    /// As [`at`](Self::at).
    pub fn display_at(&self, x: u32, y: u32) -> f32 {
        match &self.samples {
            Samples::Bytes { bytes, color, tables } => {
                tables.display[usize::from(self.samples_at(bytes, *color, x, y)[0])]
            }
            Samples::Linear(film, _) => srgb_encode(film.at(x, y)[0]),
        }
    }

    /// The alpha of a pixel, 0 to 1 as a rule; 1 if the image has no alpha channel.
    ///
    /// # Panics
    /// As [`at`](Self::at), if there is an alpha channel.
    #[inline]
    pub fn alpha_at(&self, x: u32, y: u32) -> f32 {
        match &self.samples {
            Samples::Bytes { bytes, color, .. } if color.has_alpha() => {
                let pixel = self.samples_at(bytes, *color, x, y);
                of_byte(pixel[pixel.len() - 1])
            }
            Samples::Linear(_, Some(alpha)) => alpha[self.index(x, y)],
            _ => 1.0,
        }
    }

    /// Whether the image has an alpha channel.
    pub fn has_alpha(&self) -> bool {
        match &self.samples {
            Samples::Bytes { color, .. } => color.has_alpha(),
            Samples::Linear(_, alpha) => alpha.is_some(),
        }
    }

    /// The alpha of all pixels, row by row; `None` if the image has no alpha channel.
    pub fn alpha(&self) -> Option<impl Iterator<Item = f32> + '_> {
        let row = move |y| (0..self.width).map(move |x| self.alpha_at(x, y));
        self.has_alpha().then(|| (0..self.height).flat_map(row))
    }

    /// The first number of a pixel, row by row, that is a NaN or an infinity.
    pub fn first_non_finite(&self) -> Option<f32> {
        match &self.samples {
            Samples::Bytes { .. } => None,
            Samples::Linear(film, _) => {
                film.pixels.as_flattened().iter().copied().find(|v| !v.is_finite())
            }
        }
    }

    /// The same image with its values in single precision: a pixel takes 12 bytes or more, and less
    /// time where pixels are read one by one.
    #[must_use]
    pub fn decoded(self) -> Self {
        let (film, alpha) = self.into_film();
        StoredImage::of_film(film, alpha)
    }

    /// The whole image in linear RGB, and its alpha channel if it has one.
    pub fn into_film(self) -> (Film, Option<Vec<f32>>) {
        let (width, height) = (self.width, self.height);
        match self.samples {
            Samples::Bytes { bytes, color, tables } => {
                let mut pixels = vec![[0.0; 3]; width as usize * height as usize];
                tables.decode(&bytes, color, &mut pixels);
                let last = |pixel: &[u8]| of_byte(pixel[pixel.len() - 1]);
                let all = bytes.chunks_exact(color.channel_count().into());
                let alpha = color.has_alpha().then(|| all.map(last).collect());
                (Film { width, height, pixels }, alpha)
            }
            Samples::Linear(film, alpha) => (film, alpha),
        }
    }

    fn index(&self, x: u32, y: u32) -> usize {
        y as usize * self.width as usize + x as usize
    }

    /// The samples of a pixel.
    #[inline]
    fn samples_at<'a>(&self, bytes: &'a [u8], color: ColorType, x: u32, y: u32) -> &'a [u8] {
        let channels = usize::from(color.channel_count());
        &bytes[self.index(x, y) * channels..][..channels]
    }
}
