//! Reading and writing images.

use std::fs::File;
use std::io::{BufReader, Cursor, ErrorKind};
use std::path::Path;

use image::{DynamicImage, ImageError, ImageFormat, ImageReader, Rgb32FImage};

use super::{atomic_write, read_npy, write_npy};
use crate::InputError;
use film::{Film, srgb_decode, srgb_encode};

fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase()
}

/// The width and height of an image file, from its header.
///
/// # Errors
/// If the file is missing or no image.
pub fn image_size(path: &Path) -> Result<(u32, u32), InputError> {
    if extension(path) == "npy" {
        return read_npy_image(path).map(|film| (film.width, film.height));
    }
    let file = File::open(path).map_err(|e| unreadable(path, &e))?;
    let reader = ImageReader::new(BufReader::new(file))
        .with_guessed_format()
        .map_err(|e| unreadable(path, &e))?;
    reader.into_dimensions().map_err(|e| no_image(path, e))
}

/// Reads an image as linear RGB, and its alpha channel if it has one (row-major, 0 to 1, not
/// applied to the colours).
///
/// PNG and JPEG (8 or 16 bits a channel, grey or colour) are taken as sRGB, EXR and NPY (height ×
/// width × 3, or grey) as linear. What the file holds decides, not its extension; NPY is recognised
/// by the extension.
///
/// # Errors
/// If the file is missing, cut short or no image.
pub fn read_image(path: &Path) -> Result<(Film, Option<Vec<f32>>), InputError> {
    if extension(path) == "npy" {
        return read_npy_image(path).map(|film| (film, None));
    }
    let bytes = std::fs::read(path).map_err(|e| unreadable(path, &e))?;
    if bytes.is_empty() {
        return Err(InputError::new(path, "image", "an empty file", IMAGE));
    }
    let reader = ImageReader::new(Cursor::new(&bytes))
        .with_guessed_format()
        .map_err(|e| unreadable(path, &e))?;
    let format = reader.format();
    let whole = match format {
        Some(ImageFormat::Jpeg) => is_whole_jpeg(&bytes),
        Some(ImageFormat::Png) => {
            bytes.windows(4).rposition(|w| w == b"IEND").is_some_and(|at| at + 8 <= bytes.len())
        }
        _ => true,
    };
    if !whole {
        return Err(InputError::new(path, "image", "an image that is cut short", "a whole image"));
    }
    let image = reader.decode().map_err(|e| no_image(path, e))?;
    let decode = |v: f32| if format == Some(ImageFormat::OpenExr) { v } else { srgb_decode(v) };
    let (width, height) = (image.width(), image.height());
    let rgba = image.color().has_alpha().then(|| image.to_rgba32f());
    let alpha = rgba.map(|rgba| rgba.pixels().map(|p| p.0[3]).collect());
    let pixels = image.into_rgb32f().pixels().map(|p| p.0.map(decode)).collect();
    Ok((Film { width, height, pixels }, alpha))
}

/// What an image file should be.
const IMAGE: &str = "a PNG, JPEG, EXR or NPY image";

fn unreadable(path: &Path, error: &std::io::Error) -> InputError {
    match error.kind() {
        ErrorKind::NotFound => InputError::new(path, "image", "no such file", IMAGE),
        _ => InputError::new(path, "image", error, "a readable file"),
    }
}

/// Decoders say in many ways that bytes are missing; an end of file is somewhere in the chain of
/// causes.
fn no_image(path: &Path, error: ImageError) -> InputError {
    if let ImageError::Unsupported(_) = error {
        return InputError::new(path, "image", format!("no image ({error})"), IMAGE);
    }
    let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(&error);
    let mut cut = false;
    while let Some(inner) = cause {
        let text = inner.to_string();
        cut |= inner
            .downcast_ref::<std::io::Error>()
            .is_some_and(|e| e.kind() == ErrorKind::UnexpectedEof);
        cut |= ["unexpected end of file", "failed to fill whole buffer", "missing bytes"]
            .iter()
            .any(|t| text.contains(t));
        cause = inner.source();
    }
    let (found, expected) = if cut {
        ("an image that is cut short", "a whole image")
    } else {
        ("a damaged image", IMAGE)
    };
    InputError::new(path, "image", format!("{found} ({error})"), expected)
}

/// The decoder fills what is missing of a JPEG with grey. After the last start of a scan (FF DA) a
/// whole file has an end of the image (FF D9), which cannot occur within a scan.
fn is_whole_jpeg(bytes: &[u8]) -> bool {
    let last = |marker: u8| bytes.windows(2).rposition(|w| w == [0xff, marker]);
    matches!((last(0xda), last(0xd9)), (Some(scan), Some(end)) if scan < end)
}

fn read_npy_image(path: &Path) -> Result<Film, InputError> {
    let (shape, data) = read_npy(path)?;
    let (size, channels) = match shape.as_slice() {
        &[height, width] | &[height, width, 1] => ([width, height], 1),
        &[height, width, 3] => ([width, height], 3),
        _ => {
            return Err(InputError::new(
                path,
                "shape",
                format!("{shape:?}"),
                "[height, width, 3], or 1 for grey",
            ));
        }
    };
    let [Ok(width), Ok(height)] = size.map(u32::try_from) else {
        return Err(InputError::new(
            path,
            "shape",
            format!("{shape:?}"),
            "a size that fits into 32 bits",
        ));
    };
    if width == 0 || height == 0 {
        return Err(InputError::new(
            path,
            "shape",
            format!("{shape:?}"),
            "a width and height of 1 or more",
        ));
    }
    let pixels =
        data.chunks_exact(channels).map(|p| [p[0], p[channels / 2], p[channels - 1]]).collect();
    Ok(Film { width, height, pixels })
}

/// Writes an image by its extension: .png as 8-bit sRGB (clipped), .exr and .npy as linear float32.
///
/// # Errors
/// If the extension is another one, or the file cannot be written.
pub fn write_image(path: &Path, film: &Film) -> anyhow::Result<()> {
    match extension(path).as_str() {
        "npy" => write_npy(
            path,
            &[film.height as usize, film.width as usize, 3],
            film.pixels.as_flattened(),
        ),
        "exr" => {
            let buffer =
                Rgb32FImage::from_raw(film.width, film.height, film.pixels.as_flattened().to_vec());
            encode(path, buffer.map(DynamicImage::ImageRgb32F), ImageFormat::OpenExr)
        }
        "png" => {
            let bytes = film
                .pixels
                .as_flattened()
                .iter()
                .map(|v| (srgb_encode(*v).clamp(0.0, 1.0) * 255.0).round() as u8);
            let buffer = image::RgbImage::from_raw(film.width, film.height, bytes.collect());
            encode(path, buffer.map(DynamicImage::ImageRgb8), ImageFormat::Png)
        }
        other => Err(InputError::new(
            path,
            "output",
            format!("extension \"{other}\""),
            ".png, .exr or .npy",
        )
        .into()),
    }
}

fn encode(path: &Path, image: Option<DynamicImage>, format: ImageFormat) -> anyhow::Result<()> {
    let image =
        image.ok_or_else(|| anyhow::anyhow!("an image has as many pixels as its size says"))?;
    let mut bytes = Cursor::new(Vec::new());
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
    fn missing_cut_and_foreign_files_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let noise = |x: u32, y: u32| {
            image::Rgb([x * 37 + y * 101, x * 91 + y * 17, x * y].map(|v| (v % 256) as u8))
        };
        for name in ["a.png", "a.jpg", "a.exr", "a.npy"] {
            let path = folder.path().join(name);
            assert!(read_image(&path).unwrap_err().to_string().contains("no such file"), "{name}");
            match name {
                "a.jpg" => image::RgbImage::from_fn(64, 64, noise).save(&path).unwrap(),
                _ => write_image(&path, &film()).unwrap(),
            }
            read_image(&path).unwrap();
            let whole = std::fs::read(&path).unwrap();
            for length in [whole.len() / 2, whole.len() * 3 / 4, whole.len() - 1] {
                std::fs::write(&path, &whole[..length]).unwrap();
                let error =
                    read_image(&path).expect_err(&format!("{name} cut at {length}")).to_string();
                assert!(error.contains(name) && error.contains("cut short"), "{error}");
            }
            for junk in ["", "some words, and more of them"] {
                std::fs::write(&path, junk).unwrap();
                let error = read_image(&path).expect_err(name).to_string();
                assert!(error.contains(name) && !error.contains("cut short"), "{error}");
            }
        }
    }

    #[test]
    fn every_depth_and_channel_count_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let half = srgb_decode(0.5);
        let grey16 =
            image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(3, 2, image::Luma([0x8000]));
        grey16.save(at("grey16.png")).unwrap();
        image::ImageBuffer::<image::LumaA<u8>, _>::from_pixel(3, 2, image::LumaA([255, 51]))
            .save(at("alpha.png"))
            .unwrap();
        let (grey, none) = read_image(&at("grey16.png")).unwrap();
        assert!(
            none.is_none() && grey.pixels.iter().all(|p| p.iter().all(|c| (c - half).abs() < 1e-4)),
            "{grey:?}"
        );
        let (white, alpha) = read_image(&at("alpha.png")).unwrap();
        assert_eq!(white.pixels[5], [1.0; 3]);
        assert!((alpha.unwrap()[5] - 0.2).abs() < 1e-6);
        for shape in [&[2, 3][..], &[2, 3, 1]] {
            write_npy(&at("grey.npy"), shape, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
            let (grey, _) = read_image(&at("grey.npy")).unwrap();
            assert_eq!((grey.width, grey.height, grey.at(2, 1)), (3, 2, [5.0; 3]));
        }
        write_npy(&at("odd.npy"), &[3, 2], &[0.0; 6]).unwrap();
        for shape in [&[6][..], &[1, 3, 2], &[0, 3]] {
            write_npy(&at("odd.npy"), shape, &vec![0.0; shape.iter().product()]).unwrap();
            assert!(read_image(&at("odd.npy")).is_err(), "{shape:?}");
        }
        assert_eq!(image_size(&at("grey16.png")).unwrap(), (3, 2));
        assert_eq!(image_size(&at("grey.npy")).unwrap(), (3, 2));
        assert!(image_size(&at("none.png")).unwrap_err().to_string().contains("no such file"));
    }
}
