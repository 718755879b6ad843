//! Reading and writing images.

use std::path::Path;

use image::{DynamicImage, ImageFormat, ImageReader, Rgb32FImage};

use super::{atomic_write, read_npy, write_npy};
use crate::error::InputError;
use crate::film::{Film, srgb_decode, srgb_encode};

fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase()
}

/// The width and height of an image file, from its header.
///
/// # Errors
/// If the file is missing or no image.
pub fn image_size(path: &Path) -> Result<(u32, u32), InputError> {
    image::image_dimensions(path).map_err(|e| InputError::new(path, "image", e, "a readable image"))
}

/// Reads an image as linear RGB, and its alpha channel if it has one (row-major, 0 to 1, not applied to the colours).
///
/// PNG and JPEG are taken as sRGB, EXR and NPY (height × width × 3) as linear.
///
/// # Errors
/// If the file is missing, truncated or no image.
pub fn read_image(path: &Path) -> Result<(Film, Option<Vec<f32>>), InputError> {
    if extension(path) == "npy" {
        return read_npy_image(path).map(|film| (film, None));
    }
    let error = |e: &dyn std::fmt::Display| InputError::new(path, "image", e, "a readable PNG, JPEG, EXR or NPY image");
    let reader = ImageReader::open(path).map_err(|e| error(&e))?.with_guessed_format().map_err(|e| error(&e))?;
    let linear = reader.format() == Some(ImageFormat::OpenExr);
    let image = reader.decode().map_err(|e| error(&e))?;
    let decode = |v: f32| if linear { v } else { srgb_decode(v) };
    let (width, height) = (image.width(), image.height());
    let rgba = image.color().has_alpha().then(|| image.to_rgba32f());
    let alpha = rgba.map(|rgba| rgba.pixels().map(|p| p.0[3]).collect());
    let pixels = image.into_rgb32f().pixels().map(|p| p.0.map(decode)).collect();
    Ok((Film { width, height, pixels }, alpha))
}

fn read_npy_image(path: &Path) -> Result<Film, InputError> {
    let (shape, data) = read_npy(path)?;
    let &[height, width, 3] = shape.as_slice() else {
        return Err(InputError::new(path, "shape", format!("{shape:?}"), "[height, width, 3]"));
    };
    let pixels = data.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    Ok(Film { width: width as u32, height: height as u32, pixels })
}

/// Writes an image by its extension: .png as 8-bit sRGB (clipped), .exr and .npy as linear float32.
///
/// # Errors
/// If the extension is another one, or the file cannot be written.
pub fn write_image(path: &Path, film: &Film) -> anyhow::Result<()> {
    match extension(path).as_str() {
        "npy" => write_npy(path, &[film.height as usize, film.width as usize, 3], film.pixels.as_flattened()),
        "exr" => {
            let buffer = Rgb32FImage::from_raw(film.width, film.height, film.pixels.as_flattened().to_vec());
            encode(path, buffer.map(DynamicImage::ImageRgb32F), ImageFormat::OpenExr)
        }
        "png" => {
            let bytes =
                film.pixels.as_flattened().iter().map(|v| (srgb_encode(*v).clamp(0.0, 1.0) * 255.0).round() as u8);
            let buffer = image::RgbImage::from_raw(film.width, film.height, bytes.collect());
            encode(path, buffer.map(DynamicImage::ImageRgb8), ImageFormat::Png)
        }
        other => Err(InputError::new(path, "output", format!("extension \"{other}\""), ".png, .exr or .npy").into()),
    }
}

fn encode(path: &Path, image: Option<DynamicImage>, format: ImageFormat) -> anyhow::Result<()> {
    let image = image.ok_or_else(|| anyhow::anyhow!("an image has as many pixels as its size says"))?;
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, format)?;
    atomic_write(path, |out| Ok(out.write_all(bytes.get_ref())?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn film() -> Film {
        let pixels = (0..12).map(|i| [i as f32 / 11.0, 0.5, 1.0 - i as f32 / 11.0]).collect();
        Film { width: 4, height: 3, pixels }
    }

    #[test]
    fn images_come_back_in_every_format() {
        let folder = tempfile::tempdir().unwrap();
        for (name, tolerance) in [("a.png", 0.01), ("a.exr", 0.0), ("a.npy", 0.0)] {
            let path = folder.path().join(name);
            write_image(&path, &film()).unwrap();
            let (read, alpha) = read_image(&path).unwrap();
            assert_eq!((read.width, read.height, alpha.is_some()), (4, 3, false));
            for (a, b) in read.pixels.as_flattened().iter().zip(film().pixels.as_flattened()) {
                assert!((a - b).abs() <= tolerance, "{name}: {a} against {b}");
            }
        }
        assert!(write_image(&folder.path().join("a.gif"), &film()).is_err());
    }

    #[test]
    fn truncated_and_missing_images_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        assert!(read_image(&path).unwrap_err().to_string().contains("a.png"));
        write_image(&path, &film()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for length in [0, 10, whole.len() / 2] {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(read_image(&path).is_err(), "cut at {length}");
        }
    }
}
