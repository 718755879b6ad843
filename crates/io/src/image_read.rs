//! Reading images, with errors that tell missing, cut, damaged and foreign files apart.

use std::io::{BufReader, Cursor, ErrorKind};
use std::path::Path;

use film::{Film, srgb_decode};
use image::{DynamicImage, ImageError, ImageFormat, ImageReader};

use crate::{InputError, check_memory, extension, open, read, read_npy};

/// The files that can be read, for messages.
const IMAGE: &str = "a PNG, JPEG, EXR or NPY image";

/// Bytes of memory for each pixel while an image is read: as decoded, with 16 and with 12 bytes in
/// single precision, and its alpha channel.
const MEMORY_PER_PIXEL: u64 = 48;

/// The width and height of an image file, in pixels.
///
/// Reads the header only, except for NPY, where the whole file is read.
///
/// # Errors
/// If the file is missing or is no image.
pub fn image_size(path: &Path) -> Result<(u32, u32), InputError> {
    if extension(path) == "npy" {
        return read_npy_image(path).map(|film| (film.width, film.height));
    }
    let (file, _) = open(path, "image", IMAGE)?;
    let reader = ImageReader::new(BufReader::new(file))
        .with_guessed_format()
        .map_err(|e| InputError::new(path, "image", e, "a readable file"))?;
    reader.into_dimensions().map_err(|e| undecodable(path, e))
}

/// Reads an image as linear RGB, and its alpha channel if it has one.
///
/// The alpha channel has width · height values from 0 to 1, in the order of the pixels. It is not
/// multiplied into the colours.
///
/// PNG and JPEG (8 or 16 bits per channel, grey or colour) are taken as sRGB. EXR and NPY are taken
/// as linear. An NPY array has the shape height × width × 3, or height × width (× 1) for grey. The
/// content of the file decides its format, not the extension; NPY alone is recognised by the
/// extension.
///
/// # Errors
/// If the file is missing, is cut short or is no image.
pub fn read_image(path: &Path) -> Result<(Film, Option<Vec<f32>>), InputError> {
    if extension(path) == "npy" {
        return read_npy_image(path).map(|film| (film, None));
    }
    let bytes = read(path, "image", IMAGE)?;
    if bytes.is_empty() {
        return Err(InputError::new(path, "image", "an empty file", IMAGE));
    }
    let reader = || ImageReader::new(Cursor::new(&bytes)).with_guessed_format();
    let unreadable = |e| InputError::new(path, "image", e, "a readable file");
    let format = reader().map_err(unreadable)?.format();
    if !is_whole(&bytes, format) {
        return Err(InputError::new(path, "image", "an image that is cut short", "a whole image"));
    }
    if format == Some(ImageFormat::Png) && !has_whole_palette(&bytes) {
        let found = "a damaged image (a palette whose length is no multiple of 3)";
        return Err(InputError::new(path, "image", found, IMAGE));
    }
    let size = reader().map_err(unreadable)?.into_dimensions();
    let (width, height) = size.map_err(|e| undecodable(path, e))?;
    let memory = u64::from(width).saturating_mul(u64::from(height) * MEMORY_PER_PIXEL);
    check_memory(path, "size", format!("{width} x {height} pixels"), memory)?;
    let image = reader().map_err(unreadable)?.decode().map_err(|e| undecodable(path, e))?;
    Ok(linear(image, format == Some(ImageFormat::OpenExr)))
}

/// The linear film and the alpha channel of a decoded image.
fn linear(image: DynamicImage, is_linear: bool) -> (Film, Option<Vec<f32>>) {
    let decode = |v: f32| if is_linear { v } else { srgb_decode(v) };
    let (width, height) = (image.width(), image.height());
    let rgba = image.color().has_alpha().then(|| image.to_rgba32f());
    let alpha = rgba.map(|rgba| rgba.pixels().map(|p| p.0[3]).collect());
    let pixels = image.into_rgb32f().pixels().map(|p| p.0.map(decode)).collect();
    (Film { width, height, pixels }, alpha)
}

/// Whether the end of a PNG or JPEG file is there. Other formats count as whole here; their
/// decoders report a missing part.
fn is_whole(bytes: &[u8], format: Option<ImageFormat>) -> bool {
    match format {
        Some(ImageFormat::Jpeg) => is_whole_jpeg(bytes),
        Some(ImageFormat::Png) => is_whole_png(bytes),
        _ => true,
    }
}

/// A PNG file ends with the chunk IEND: four letters, then a checksum of four bytes.
fn is_whole_png(bytes: &[u8]) -> bool {
    bytes.windows(4).rposition(|w| w == b"IEND").is_some_and(|at| at + 8 <= bytes.len())
}

/// Whether every palette of a PNG file (chunk PLTE) has three bytes a colour. The decoder panics
/// at a palette that ends within a colour.
///
/// A chunk has its length (four bytes, the highest first), its name (four letters), its content,
/// and a checksum of four bytes. The first one starts at byte 8.
fn has_whole_palette(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(8..).unwrap_or_default();
    while let Some((length, after)) = rest.split_first_chunk() {
        let length = u32::from_be_bytes(*length) as usize;
        if after.starts_with(b"PLTE") && !length.is_multiple_of(3) {
            return false;
        }
        rest = after.get(length.saturating_add(8)..).unwrap_or_default();
    }
    true
}

/// Whether the last scan of a JPEG file (ITU-T T.81) is complete.
///
/// The decoder fills the missing part of a scan with grey and reports no error. In a whole file the
/// last start of scan (FF DA) is followed by an end of image (FF D9), a pair of bytes that cannot
/// occur within a scan.
fn is_whole_jpeg(bytes: &[u8]) -> bool {
    let last = |marker: u8| bytes.windows(2).rposition(|w| w == [0xff, marker]);
    matches!((last(0xda), last(0xd9)), (Some(scan), Some(end)) if scan < end)
}

/// The error of a file that the decoder refused: no image, a cut one or a damaged one.
fn undecodable(path: &Path, error: ImageError) -> InputError {
    if let ImageError::Unsupported(_) = error {
        return InputError::new(path, "image", format!("no image ({error})"), IMAGE);
    }
    let (found, expected) = if is_cut_short(&error) {
        ("an image that is cut short", "a whole image")
    } else {
        ("a damaged image", IMAGE)
    };
    InputError::new(path, "image", format!("{found} ({error})"), expected)
}

/// Whether an end of file is in the chain of causes. Decoders report missing bytes either with the
/// kind `UnexpectedEof` or in the text of an error only.
fn is_cut_short(error: &ImageError) -> bool {
    let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(error);
    while let Some(error) = cause {
        let is_end = error
            .downcast_ref::<std::io::Error>()
            .is_some_and(|e| e.kind() == ErrorKind::UnexpectedEof);
        let text = error.to_string();
        let says_end = ["unexpected end of file", "failed to fill whole buffer", "missing bytes"]
            .iter()
            .any(|t| text.contains(t));
        if is_end || says_end {
            return true;
        }
        cause = error.source();
    }
    false
}

fn read_npy_image(path: &Path) -> Result<Film, InputError> {
    let (shape, data) = read_npy(path)?;
    let shape_error =
        |expected: &str| InputError::new(path, "shape", format!("{shape:?}"), expected);
    let (size, channels) = match shape.as_slice() {
        &[height, width] | &[height, width, 1] => ([width, height], 1),
        &[height, width, 3] => ([width, height], 3),
        _ => return Err(shape_error("[height, width, 3], or 1 for grey")),
    };
    let [Ok(width), Ok(height)] = size.map(u32::try_from) else {
        return Err(shape_error("a width and height below 2^32"));
    };
    if width == 0 || height == 0 {
        return Err(shape_error("a width and height of 1 or more"));
    }
    // For one channel all three indices are 0; for three channels they are 0, 1 and 2.
    let pixels =
        data.chunks_exact(channels).map(|p| [p[0], p[channels / 2], p[channels - 1]]).collect();
    Ok(Film { width, height, pixels })
}
