//! Writing images.

use std::io::{self, Cursor};
use std::path::Path;

use files::{InputError, WriteError, atomic_write, extension};
use image::{DynamicImage, ImageFormat, Rgb32FImage, RgbImage};

use crate::film::Film;
use crate::npy::write_npy;
use crate::srgb::srgb_encode;

/// An image that cannot become the content of a file.
#[derive(Debug, thiserror::Error)]
pub enum EncodeError {
    /// The count of pixels is not the product of width and height.
    #[error("an image of {width} x {height} pixels holds {count} pixels")]
    Pixels {
        /// The width in pixels.
        width: u32,
        /// The height in pixels.
        height: u32,
        /// The count of pixels.
        count: usize,
    },
    /// The format cannot hold the image.
    #[error(transparent)]
    Format(#[from] image::ImageError),
}

/// Writes an image in the format of its extension, and replaces a file at `path` whole.
///
/// A .png file gets 8-bit sRGB, clipped to [0, 1]. Files in .exr and .npy get linear float32; the
/// array in .npy has the shape height × width × 3.
///
/// # Errors
/// [`WriteError::Input`] if the extension is another one or the folder does not accept files.
/// [`WriteError::File`] if the image cannot be encoded ([`EncodeError`]) or the file not be written.
pub fn write_image(path: &Path, film: &Film) -> Result<(), WriteError> {
    let bytes = match extension(path).as_str() {
        "npy" => {
            let shape = [film.height as usize, film.width as usize, 3];
            return write_npy(path, &shape, film.pixels.as_flattened());
        }
        "exr" => {
            let values = film.pixels.as_flattened().to_vec();
            let buffer = Rgb32FImage::from_raw(film.width, film.height, values);
            encoded(film, buffer.map(DynamicImage::ImageRgb32F), ImageFormat::OpenExr)
        }
        "png" => png(film),
        other => {
            let found = format!("extension \"{other}\"");
            return Err(InputError::new(path, "output", found, ".png, .exr or .npy").into());
        }
    };
    let bytes = bytes.map_err(|e| WriteError::of_file(path, io::Error::other(e)))?;
    atomic_write(path, |out| out.write_all(&bytes))
}

/// The content of a .png file with an image in 8-bit sRGB, clipped to [0, 1].
///
/// # Errors
/// If the image has fewer pixels than its width and height ask for, or none.
pub fn png(film: &Film) -> Result<Vec<u8>, EncodeError> {
    let byte = |v: &f32| (srgb_encode(*v).clamp(0.0, 1.0) * 255.0).round() as u8;
    let bytes = film.pixels.as_flattened().iter().map(byte).collect();
    let buffer = RgbImage::from_raw(film.width, film.height, bytes);
    encoded(film, buffer.map(DynamicImage::ImageRgb8), ImageFormat::Png)
}

/// The content of a file with `image`, the pixels of `film` as the encoder takes them; `None` if
/// they are fewer than the film's width and height ask for.
fn encoded(
    film: &Film,
    image: Option<DynamicImage>,
    format: ImageFormat,
) -> Result<Vec<u8>, EncodeError> {
    let (width, height, count) = (film.width, film.height, film.pixels.len());
    let image = image.ok_or(EncodeError::Pixels { width, height, count })?;
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format)?;
    Ok(bytes.into_inner())
}
