//! Reading TIFF images (TIFF 6.0) by the package `tiff`: the first image of a file.

#![warn(clippy::cast_possible_truncation)]

use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek};
use std::path::Path;

use files::{InputError, check_memory, open};
use image::metadata::Orientation;
use image::{DynamicImage, ImageBuffer};
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

use crate::cut_short::{cut_short, is_cut_short};
use crate::formats::IMAGE;

/// The kinds of TIFF images that are read, for messages.
const KINDS: &str = "a TIFF image of grey or RGB with 8 or 16 bits or floats";

/// The largest image when decoded, in bytes: the limit of the package `image` for other formats.
const LARGEST: usize = 512 << 20;

/// Bytes of memory for each pixel while an image is read: its samples in up to 32 bytes, and in
/// single precision with an alpha channel.
const MEMORY_PER_PIXEL: u64 = 48;

/// A decoded image.
pub(crate) struct Decoded {
    pub(crate) image: DynamicImage,
    pub(crate) orientation: Orientation,
    pub(crate) profile: Option<Vec<u8>>,
}

/// The entries at the start of a TIFF file.
pub(crate) struct Head {
    pub(crate) size: (u32, u32),
    pub(crate) orientation: Orientation,
    pub(crate) profile: Option<Vec<u8>>,
    /// Whether the image has colours, and whether its samples are integers.
    pub(crate) has_color: bool,
    pub(crate) is_integer: bool,
}

/// The entries of the first image of a file. Its pixels are not read.
pub(crate) fn head(path: &Path) -> Result<Head, InputError> {
    let (file, _) = open(path, "image", IMAGE)?;
    let error = |e| error_of(path, e);
    let mut decoder: Decoder<BufReader<File>> =
        Decoder::new(BufReader::new(file)).map_err(error)?;
    let layout = decoder.image_buffer_layout().map_err(error)?;
    Ok(Head {
        size: decoder.dimensions().map_err(error)?,
        orientation: orientation(&mut decoder),
        profile: decoder.get_tag_u8_vec(Tag::IccProfile).ok(),
        has_color: !is_grey(decoder.colortype().map_err(error)?),
        is_integer: layout.sample_format == tiff::tags::SampleFormat::Uint,
    })
}

/// The orientation of an image. It may be damaged although the pixels are whole.
fn orientation<R: Read + Seek>(decoder: &mut Decoder<R>) -> Orientation {
    let number = decoder.find_tag_unsigned::<u8>(Tag::Orientation).ok().flatten();
    number.and_then(Orientation::from_exif).unwrap_or(Orientation::NoTransforms)
}

/// Whether the first sample of a pixel is its grey value.
fn is_grey(color: ColorType) -> bool {
    matches!(color, ColorType::Gray(_) | ColorType::Multiband { .. })
}

/// Decodes the first image of a file with this content.
pub(crate) fn decode(path: &Path, bytes: &[u8]) -> Result<Decoded, InputError> {
    let error = |e| error_of(path, e);
    let mut limits = Limits::default();
    limits.decoding_buffer_size = LARGEST;
    limits.intermediate_buffer_size = LARGEST;
    let decoder = Decoder::new(Cursor::new(bytes)).map_err(error)?;
    let mut decoder = decoder.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(error)?;
    let memory = u64::from(width).saturating_mul(u64::from(height) * MEMORY_PER_PIXEL);
    check_memory(path, "size", format!("{width} x {height} pixels"), memory)?;
    check_parts(path, &mut decoder, bytes.len())?;
    let color = decoder.colortype().map_err(error)?;
    let mut data = DecodingResult::U8(Vec::new());
    let layout = decoder.read_image_to_buffer(&mut data).map_err(error)?;
    if data.as_buffer(0).byte_len() < layout.complete_len {
        return Err(error(TiffError::LimitsExceeded));
    }
    let extra: Vec<u16> =
        decoder.find_tag_unsigned_vec(Tag::ExtraSamples).ok().flatten().unwrap_or_default();
    let alpha = Alpha::of(extra.first().copied());
    let shape = Shape::of(color, alpha, (width, height), layout.planes > 1);
    let image = shape.and_then(|shape| shape.image(color, alpha, data));
    let image = image.ok_or_else(|| {
        InputError::new(path, "image", format!("a TIFF image of another kind ({color:?})"), KINDS)
    })?;
    let orientation = orientation(&mut decoder);
    Ok(Decoded { image, orientation, profile: decoder.get_tag_u8_vec(Tag::IccProfile).ok() })
}

/// Refuses an image whose strips or tiles do not lie in a file of this length: not every coding
/// tells that data are missing. Also refuses tables of JPEG that are shorter than their marks.
fn check_parts<R: Read + Seek>(
    path: &Path,
    decoder: &mut Decoder<R>,
    length: usize,
) -> Result<(), InputError> {
    let mut numbers =
        |tag| -> Vec<u64> { decoder.find_tag_unsigned_vec(tag).ok().flatten().unwrap_or_default() };
    for [places, lengths] in
        [[Tag::StripOffsets, Tag::StripByteCounts], [Tag::TileOffsets, Tag::TileByteCounts]]
    {
        let ends = numbers(places).into_iter().zip(numbers(lengths));
        let last = ends.map(|(place, bytes)| place.saturating_add(bytes)).max().unwrap_or(0);
        if last > length as u64 {
            return Err(cut_short(path, ""));
        }
    }
    let tables = decoder.find_tag(Tag::JPEGTables).ok().flatten();
    if tables.and_then(|t| t.into_u8_vec().ok()).is_some_and(|tables| tables.len() < 4) {
        let found = "a damaged image (JPEG tables of less than 4 bytes)";
        return Err(InputError::new(path, "image", found, IMAGE));
    }
    Ok(())
}

/// The error of a file that the decoder refused.
fn error_of(path: &Path, error: TiffError) -> InputError {
    if is_cut_short(&error) {
        return cut_short(path, &format!(" ({error})"));
    }
    let (found, expected) = match &error {
        TiffError::UnsupportedError(_) => ("a TIFF image of another kind", KINDS),
        TiffError::LimitsExceeded => ("an image that is too large", "at most 512 MiB"),
        _ => ("a damaged image", IMAGE),
    };
    InputError::new(path, "image", format!("{found} ({error})"), expected)
}

/// The meaning of the sample behind the colours of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Alpha {
    /// It is an alpha value that the colours are multiplied by.
    Multiplied,
    /// It is an alpha value.
    Apart,
    /// It has another meaning, or there is none.
    None,
}

impl Alpha {
    /// By the first value of the entry `ExtraSamples`.
    fn of(extra: Option<u16>) -> Self {
        match extra {
            Some(1) => Alpha::Multiplied,
            Some(2) => Alpha::Apart,
            _ => Alpha::None,
        }
    }
}

/// The arrangement of samples.
#[derive(Clone, Copy, Debug)]
struct Shape {
    size: (u32, u32),
    /// Samples of a pixel in the file.
    stored: usize,
    /// The first of them, which are read: grey or RGB, and alpha.
    read: usize,
    /// Whether each channel is stored by itself.
    is_planar: bool,
}

impl Shape {
    fn of(color: ColorType, alpha: Alpha, size: (u32, u32), is_planar: bool) -> Option<Self> {
        let (stored, read) = match color {
            ColorType::Gray(_) => (1, 1),
            ColorType::Multiband { num_samples, .. } => {
                (usize::from(num_samples), if alpha == Alpha::None { 1 } else { 2 })
            }
            ColorType::RGB(_) | ColorType::YCbCr(8) => (3, 3),
            ColorType::RGBA(_) => (4, 4),
            _ => return None,
        };
        (read <= stored).then_some(Shape { size, stored, read, is_planar })
    }

    /// The image of decoded samples; `None` if they have a type or number that is not read.
    fn image(self, color: ColorType, alpha: Alpha, data: DecodingResult) -> Option<DynamicImage> {
        match data {
            DecodingResult::U8(bytes) => {
                let bits = color.bit_depth();
                let bytes = if bits < 8 { self.expanded(&bytes, bits)? } else { bytes };
                let mut bytes = self.samples(bytes)?;
                match color {
                    ColorType::YCbCr(_) => bytes.as_chunks_mut().0.iter_mut().for_each(to_rgb),
                    _ => self.divide(&mut bytes, alpha, |v, a| {
                        let divided = (u32::from(v) * 255 + u32::from(a) / 2) / u32::from(a).max(1);
                        u8::try_from(divided).unwrap_or(u8::MAX)
                    }),
                }
                self.image_of_bytes(bytes)
            }
            DecodingResult::U16(samples) if color.bit_depth() == 16 => {
                let mut samples = self.samples(samples)?;
                self.divide(&mut samples, alpha, |v, a| {
                    let divided = (u64::from(v) * 65535 + u64::from(a) / 2) / u64::from(a).max(1);
                    u16::try_from(divided).unwrap_or(u16::MAX)
                });
                self.image_of_words(samples)
            }
            DecodingResult::F16(samples) => {
                self.image_of_floats(samples.into_iter().map(f32::from).collect(), alpha)
            }
            DecodingResult::F32(samples) => self.image_of_floats(samples, alpha),
            DecodingResult::F64(samples) => {
                self.image_of_floats(samples.into_iter().map(rounded).collect(), alpha)
            }
            _ => None,
        }
    }

    /// A byte for each grey value of 1, 2 or 4 bits. Each row starts with a byte of its own.
    fn expanded(self, bytes: &[u8], bits: u8) -> Option<Vec<u8>> {
        let (1 | 2 | 4, 1) = (bits, self.stored) else { return None };
        let width = self.size.0 as usize;
        let in_byte = usize::from(8 / bits);
        let scale = 255 / (u8::MAX >> (8 - bits));
        let rows = bytes.chunks_exact(width.div_ceil(in_byte).max(1));
        let value = |row: &[u8], x: usize| {
            let shifted = row[x / in_byte] << (x % in_byte * usize::from(bits));
            (shifted >> (8 - bits)) * scale
        };
        Some(rows.flat_map(|row| (0..width).map(move |x| value(row, x))).collect())
    }

    /// The samples that are read, pixel by pixel; `None` if their number is wrong.
    fn samples<T: Copy>(self, samples: Vec<T>) -> Option<Vec<T>> {
        let pixels = self.size.0 as usize * self.size.1 as usize;
        if samples.len() != pixels.checked_mul(self.stored)? || pixels == 0 {
            return None;
        }
        if self.is_planar {
            let channels = 0..self.read;
            let pixel = |i: usize| channels.clone().map(move |c| c * pixels + i);
            return Some((0..pixels).flat_map(pixel).map(|at| samples[at]).collect());
        }
        if self.read == self.stored {
            return Some(samples);
        }
        let pixels = samples.chunks_exact(self.stored);
        Some(pixels.flat_map(|pixel| &pixel[..self.read]).copied().collect())
    }

    /// Divides colours that are multiplied by alpha.
    fn divide<T: Copy>(self, samples: &mut [T], alpha: Alpha, divided: impl Fn(T, T) -> T) {
        if alpha != Alpha::Multiplied || !self.read.is_multiple_of(2) {
            return;
        }
        for pixel in samples.chunks_exact_mut(self.read) {
            if let Some((alpha, colors)) = pixel.split_last_mut() {
                colors.iter_mut().for_each(|color| *color = divided(*color, *alpha));
            }
        }
    }

    fn image_of_bytes(self, bytes: Vec<u8>) -> Option<DynamicImage> {
        let (width, height) = self.size;
        Some(match self.read {
            1 => DynamicImage::ImageLuma8(ImageBuffer::from_raw(width, height, bytes)?),
            2 => DynamicImage::ImageLumaA8(ImageBuffer::from_raw(width, height, bytes)?),
            3 => DynamicImage::ImageRgb8(ImageBuffer::from_raw(width, height, bytes)?),
            _ => DynamicImage::ImageRgba8(ImageBuffer::from_raw(width, height, bytes)?),
        })
    }

    fn image_of_words(self, samples: Vec<u16>) -> Option<DynamicImage> {
        let (width, height) = self.size;
        Some(match self.read {
            1 => DynamicImage::ImageLuma16(ImageBuffer::from_raw(width, height, samples)?),
            2 => DynamicImage::ImageLumaA16(ImageBuffer::from_raw(width, height, samples)?),
            3 => DynamicImage::ImageRgb16(ImageBuffer::from_raw(width, height, samples)?),
            _ => DynamicImage::ImageRgba16(ImageBuffer::from_raw(width, height, samples)?),
        })
    }

    /// An image of floats, always with colours.
    fn image_of_floats(self, samples: Vec<f32>, alpha: Alpha) -> Option<DynamicImage> {
        let mut samples = self.samples(samples)?;
        self.divide(&mut samples, alpha, |v, a| if a == 0.0 { v } else { v / a });
        if self.read < 3 {
            let pixels = samples.chunks_exact(self.read);
            samples = pixels.flat_map(|p| [&[p[0]; 3], &p[1..]].concat()).collect();
        }
        let (width, height) = self.size;
        Some(match self.read {
            1 | 3 => DynamicImage::ImageRgb32F(ImageBuffer::from_raw(width, height, samples)?),
            _ => DynamicImage::ImageRgba32F(ImageBuffer::from_raw(width, height, samples)?),
        })
    }
}

/// A number rounded to single precision.
#[expect(clippy::cast_possible_truncation, reason = "it rounds, and large numbers become infinite")]
fn rounded(number: f64) -> f32 {
    number as f32
}

/// Converts a pixel from the brightness and colour differences of JPEG (ITU-T T.871) to RGB.
fn to_rgb(pixel: &mut [u8; 3]) {
    let [y, blue, red] = pixel.map(f32::from);
    let (blue, red) = (blue - 128.0, red - 128.0);
    let rgb = [y + 1.402 * red, y - 0.344_136 * blue - 0.714_136 * red, y + 1.772 * blue];
    // The conversion clips to the range of a byte.
    #[expect(clippy::cast_possible_truncation, reason = "the value is a whole number of a byte")]
    let byte = |v: f32| v.round().clamp(0.0, 255.0) as u8;
    *pixel = rgb.map(byte);
}
