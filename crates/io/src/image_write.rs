//! Writing images.

use std::io::Cursor;
use std::path::Path;

use film::{Film, srgb_encode};
use image::{DynamicImage, ImageFormat, Rgb32FImage, RgbImage};

use crate::{InputError, atomic_write, extension, write_npy};

/// Writes an image in the format of its extension, and replaces a file at `path` whole.
///
/// A .png file gets 8-bit sRGB, clipped to [0, 1]. Files in .exr and .npy get linear float32; the
/// array in .npy has the shape height × width × 3.
///
/// # Errors
/// An [`InputError`] if the extension is another one or the folder does not accept files. Other
/// errors if the file cannot be written.
pub fn write_image(path: &Path, film: &Film) -> anyhow::Result<()> {
    let values = film.pixels.as_flattened();
    match extension(path).as_str() {
        "npy" => write_npy(path, &[film.height as usize, film.width as usize, 3], values),
        "exr" => {
            let buffer = Rgb32FImage::from_raw(film.width, film.height, values.to_vec());
            encode(path, film, buffer.map(DynamicImage::ImageRgb32F), ImageFormat::OpenExr)
        }
        "png" => {
            let byte = |v: &f32| (srgb_encode(*v).clamp(0.0, 1.0) * 255.0).round() as u8;
            let bytes = values.iter().map(byte).collect();
            let buffer = RgbImage::from_raw(film.width, film.height, bytes);
            encode(path, film, buffer.map(DynamicImage::ImageRgb8), ImageFormat::Png)
        }
        other => {
            let found = format!("extension \"{other}\"");
            Err(InputError::new(path, "output", found, ".png, .exr or .npy").into())
        }
    }
}

/// Writes `image`, the pixels of `film` as the encoder takes them; `None` if they are fewer than
/// the film's width and height ask for.
fn encode(
    path: &Path,
    film: &Film,
    image: Option<DynamicImage>,
    format: ImageFormat,
) -> anyhow::Result<()> {
    let image = image.ok_or_else(|| {
        let (width, height, count) = (film.width, film.height, film.pixels.len());
        anyhow::anyhow!("an image of {width} x {height} pixels holds {count} pixels")
    })?;
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format)?;
    atomic_write(path, |out| Ok(out.write_all(bytes.get_ref())?))
}
