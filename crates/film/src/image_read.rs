//! Reading images, with errors that tell missing, cut, damaged and foreign files apart.

#![warn(clippy::cast_possible_truncation)]

use std::borrow::Cow;
use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::path::Path;

use files::{InputError, check_memory, extension, open, read};
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader};

use crate::cut_short::{cut_short, is_cut_short};
use crate::exif::{self, FocalLength};
use crate::film::Film;
use crate::foreign::{refuse, refuse_content, refuse_unconverted};
use crate::formats::IMAGE;
use crate::npy::read_npy;
use crate::profile::Plan;
use crate::stored::StoredImage;
use crate::tiff_read;
use crate::{jpeg, raw};

/// Bytes of memory for each pixel while an image is read: as decoded, with 16 and with 12 bytes in
/// single precision, and its alpha channel.
const MEMORY_PER_PIXEL: u64 = 48;

/// The same for a JPEG image: the file, 3 bytes as decoded, and 12 in single precision.
const MEMORY_PER_JPEG_PIXEL: u64 = 16;

/// The same for a JPEG image as [`read_stored_image_of`] reads it: the file, 3 bytes as decoded,
/// and 6 for the coefficients of a progressive image, or 3 for a turned copy.
const MEMORY_PER_STORED_JPEG_PIXEL: u64 = 10;

/// Bytes of memory for each pixel while [`read_stored_image_of`] reads this file, by its extension.
pub fn reading_memory(path: &Path) -> u64 {
    match extension(path).as_str() {
        "jpg" | "jpeg" => MEMORY_PER_STORED_JPEG_PIXEL,
        _ => MEMORY_PER_PIXEL,
    }
}

fn memory_per_pixel(is_jpeg: bool) -> u64 {
    if is_jpeg { MEMORY_PER_JPEG_PIXEL } else { MEMORY_PER_PIXEL }
}

/// The width and height of an image file as stored, in pixels. An EXIF orientation is ignored.
///
/// Reads the header only, except for NPY, where the whole file is read.
///
/// # Errors
/// If the file is missing or is no image. HEIF, camera raw and other files that are not read are
/// refused with the name of a converter, also in place of a missing image.
pub fn image_size(path: &Path) -> Result<(u32, u32), InputError> {
    if extension(path) == "npy" {
        return read_npy_image(path).map(|film| (film.width, film.height));
    }
    let (file, _) = open(path, "image", IMAGE).or_else(|e| missing(path, e))?;
    let unreadable = |e| InputError::new(path, "image", e, "a readable file");
    let mut file = BufReader::new(file);
    let start = file.fill_buf().map_err(unreadable)?.to_vec();
    refuse_content(path, &start, &mut file)?;
    if raw::is_tiff(&start) {
        return tiff_read::head(path).map(|head| head.size);
    }
    file.rewind().map_err(unreadable)?;
    let reader = ImageReader::new(file).with_guessed_format().map_err(unreadable)?;
    reader.into_dimensions().map_err(|e| undecodable(path, e))
}

/// The error of an image that cannot be opened: that of a file in its place that must be converted,
/// or else `error`.
fn missing<T>(path: &Path, error: InputError) -> Result<T, InputError> {
    if !path.exists() {
        refuse_unconverted(path)?;
    }
    Err(error)
}

/// Reads an image as linear RGB, and its alpha channel if it has one.
///
/// The alpha channel has width · height values from 0 to 1, in the order of the pixels. It is not
/// multiplied into the colours.
///
/// PNG, JPEG, WebP and TIFF (8 or 16 bits per channel, grey or colour) are taken as sRGB, or
/// converted to it from another [colour profile](crate::color_profile). EXR, NPY and TIFF of floats
/// are taken as linear. An NPY array has the shape height × width × 3, or height × width (× 1) for
/// grey. The content of the file decides its format, not the extension; NPY alone is recognised by
/// the extension. The pixels are those of the file: an EXIF orientation is ignored. Of several
/// images in a file, this is the first one.
///
/// # Errors
/// If the file is missing, is cut short or is no image. HEIF, camera raw and other files that are
/// not read are refused with the name of a converter, also in place of a missing image.
pub fn read_image(path: &Path) -> Result<(Film, Option<Vec<f32>>), InputError> {
    read_turned(path, None)
}

/// Like [`read_image`], for the image of a camera of this width and height in pixels.
///
/// Some programs write cameras for the pixels as stored, others for the image as its EXIF
/// orientation shows it. The size tells the two apart: the image is turned if it has the camera's
/// size then, and not as stored.
///
/// # Errors
/// As [`read_image`]. Another size is no error.
pub fn read_image_of(
    path: &Path,
    size: (u32, u32),
) -> Result<(Film, Option<Vec<f32>>), InputError> {
    read_turned(path, Some(size))
}

/// Reads an image, turned by its EXIF orientation if it has the size `expected` only then.
fn read_turned(
    path: &Path,
    expected: Option<(u32, u32)>,
) -> Result<(Film, Option<Vec<f32>>), InputError> {
    read_stored_turned(path, expected).map(StoredImage::into_film)
}

/// Like [`read_image_of`], without the conversion to single precision: the image takes the memory
/// of its samples, as the file has them.
///
/// # Errors
/// As [`read_image`]. Another size is no error.
pub fn read_stored_image_of(path: &Path, size: (u32, u32)) -> Result<StoredImage, InputError> {
    read_stored_turned(path, Some(size))
}

/// See [`read_turned`].
fn read_stored_turned(
    path: &Path,
    expected: Option<(u32, u32)>,
) -> Result<StoredImage, InputError> {
    if extension(path) == "npy" {
        return read_npy_image(path).map(|film| StoredImage::of_film(film, None));
    }
    decoded_file(path, expected).map(StoredImage::of_decoded)
}

/// Decodes a file of any format but NPY, and drops the image.
///
/// # Errors
/// As those of [`read_image`].
pub fn check_image(path: &Path) -> Result<(), InputError> {
    decoded_file(path, None).map(drop)
}

/// The image of a file, turned as [`read_turned`] says, with the colours of sRGB.
fn decoded_file(path: &Path, expected: Option<(u32, u32)>) -> Result<DynamicImage, InputError> {
    let bytes = read(path, "image", IMAGE).or_else(|e| missing(path, e))?;
    if bytes.is_empty() {
        return Err(InputError::new(path, "image", "an empty file", IMAGE));
    }
    refuse(path, &bytes)?;
    let (mut image, orientation, plan) = if raw::is_tiff(&bytes) {
        let decoded = tiff_read::decode(path, &bytes)?;
        let plan = Plan::of(Ok(decoded.profile), decoded.image.color().has_color());
        (decoded.image, decoded.orientation, plan)
    } else {
        decoded(path, &bytes)?
    };
    plan.apply(&mut image);
    let (width, height) = (image.width(), image.height());
    if width != height && expected == Some((height, width)) && swaps_sides(orientation) {
        image.apply_orientation(orientation);
    }
    Ok(image)
}

/// The image of a file with this content, as stored, its orientation, and how its colours are
/// converted.
fn decoded(path: &Path, bytes: &[u8]) -> Result<(DynamicImage, Orientation, Plan), InputError> {
    let unreadable = |e| InputError::new(path, "image", e, "a readable file");
    let guessed = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let format = guessed.map_err(unreadable)?.format();
    let Some(bytes) = whole(bytes, format) else { return Err(cut_short(path, "")) };
    let bytes: &[u8] = &bytes;
    if format == Some(ImageFormat::Png) && !has_whole_palette(bytes) {
        let found = "a damaged image (a palette whose length is no multiple of 3)";
        return Err(InputError::new(path, "image", found, IMAGE));
    }
    let reader = || ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let decoder = reader().map_err(unreadable)?.into_decoder();
    let mut decoder = decoder.map_err(|e| undecodable(path, e))?;
    let (width, height) = decoder.dimensions();
    let memory_per_pixel = memory_per_pixel(format == Some(ImageFormat::Jpeg));
    let memory = u64::from(width).saturating_mul(u64::from(height) * memory_per_pixel);
    check_memory(path, "size", format!("{width} x {height} pixels"), memory)?;
    // The orientation may be damaged although the pixels are whole.
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let plan = match format {
        Some(ImageFormat::Jpeg) => Plan::of_jpeg(bytes, &mut decoder),
        _ => Plan::of_decoder(&mut decoder),
    };
    drop(decoder);
    let decoded = reader().map_err(unreadable)?.decode();
    Ok((decoded.map_err(|e| undecodable(path, e))?, orientation, plan))
}

/// The bytes at the start of a file in which an EXIF block is looked for.
const HEAD: u64 = 1 << 18;

/// Whether an image has an EXIF orientation that changes its pixels, and how: by another size as
/// shown than as stored, or with the same size.
///
/// `None` if it has no such orientation, or if the start of the file cannot be read.
pub fn turned_by_exif(path: &Path) -> Option<TurnedByExif> {
    let head = head_of(path)?;
    let ((width, height), orientation) = if raw::is_tiff(&head) {
        let head = tiff_read::head(path).ok()?;
        (head.size, head.orientation)
    } else {
        let mut decoder = decoder_of(path, &head)?;
        (decoder.dimensions(), decoder.orientation().ok()?)
    };
    match orientation {
        Orientation::NoTransforms => None,
        turned if width != height && swaps_sides(turned) => Some(TurnedByExif::OtherSize),
        _ => Some(TurnedByExif::SameSize),
    }
}

/// The focal length in the EXIF block of an image; `None` if it has none, or if the start of the
/// file cannot be read.
pub fn focal_length(path: &Path) -> Option<FocalLength> {
    let head = head_of(path)?;
    if raw::is_tiff(&head) {
        // An EXIF block has the form of a TIFF file, and its place in one is anywhere.
        return exif::focal_length(&read(path, "image", IMAGE).ok()?);
    }
    exif::focal_length(&decoder_of(path, &head)?.exif_metadata().ok()??)
}

/// The first bytes of a file.
fn head_of(path: &Path) -> Option<Vec<u8>> {
    let mut head = Vec::new();
    open(path, "image", IMAGE).ok()?.0.take(HEAD).read_to_end(&mut head).ok()?;
    Some(head)
}

/// The decoder of an image that starts with these bytes.
fn decoder_of<'a>(path: &Path, head: &'a [u8]) -> Option<Box<dyn ImageDecoder + 'a>> {
    if head.starts_with(b"RIFF") {
        // A WebP file has its EXIF block behind its pixels.
        let file = BufReader::new(open(path, "image", IMAGE).ok()?.0);
        let reader = ImageReader::new(file).with_guessed_format().ok()?;
        return Some(Box::new(reader.into_decoder().ok()?));
    }
    let reader = ImageReader::new(Cursor::new(head)).with_guessed_format().ok()?;
    Some(Box::new(reader.into_decoder().ok()?))
}

/// The size of an image as its EXIF orientation shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TurnedByExif {
    /// Width and height are exchanged: a camera's size tells whether it is for the shown image.
    OtherSize,
    /// The size is that of the stored pixels: turned by 180 degrees, mirrored, or a square.
    SameSize,
}

/// Whether an image of this orientation is shown with its width as height.
fn swaps_sides(orientation: Orientation) -> bool {
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    matches!(orientation, Rotate90 | Rotate270 | Rotate90FlipH | Rotate270FlipH)
}

/// The content of a file as its decoder needs it; `None` if its end is missing. The decoders of
/// other formats than these report a missing part.
fn whole(bytes: &[u8], format: Option<ImageFormat>) -> Option<Cow<'_, [u8]>> {
    match format {
        Some(ImageFormat::Jpeg) => jpeg::whole_image(bytes),
        Some(ImageFormat::Png) => is_whole_png(bytes).then_some(Cow::Borrowed(bytes)),
        Some(ImageFormat::WebP) => is_whole_webp(bytes).then_some(Cow::Borrowed(bytes)),
        _ => Some(Cow::Borrowed(bytes)),
    }
}

/// A WebP file is a RIFF file: four letters, and the number of bytes that follow.
fn is_whole_webp(bytes: &[u8]) -> bool {
    let length = bytes.get(4..).and_then(|rest| rest.first_chunk());
    length.is_some_and(|length| bytes.len() - 8 >= u32::from_le_bytes(*length) as usize)
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

/// The error of a file that the decoder refused: no image, a cut one or a damaged one.
fn undecodable(path: &Path, error: ImageError) -> InputError {
    if let ImageError::Unsupported(_) = error {
        return InputError::new(path, "image", format!("no image ({error})"), IMAGE);
    }
    if is_cut_short(&error) {
        return cut_short(path, &format!(" ({error})"));
    }
    InputError::new(path, "image", format!("a damaged image ({error})"), IMAGE)
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
