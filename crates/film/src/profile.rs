//! Colour profiles (ICC.1:2022): pixels of other colours than those of sRGB are converted.

#![warn(clippy::cast_possible_truncation)]

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;
use std::sync::Arc;

use files::{extension, open, printable, read};
use image::{DynamicImage, ImageDecoder, ImageReader};
use moxcms::{
    CmsError, DataColorSpace, Layout, ProfileText, RenderingIntent, TransformExecutor,
    TransformOptions,
};

use crate::formats::IMAGE;
use crate::{exif, jpeg, raw, tiff_read};

/// The bytes at the start of a JPEG file in which a profile is looked for first.
const HEAD: u64 = 1 << 18;

/// Pixels that are converted at once.
const AT_ONCE: usize = 4096;

/// The largest change of a value of 8 bits by a profile that counts as that of sRGB. Profiles of
/// sRGB differ by the precision of their tables.
const SAME: u8 = 1;

/// The largest change of white. A profile that changes it more is damaged: the white of an image is
/// the white of a display.
const WHITE: u8 = 16;

/// The longest name of a profile in a message, in characters.
const LONGEST_NAME: usize = 60;

/// The colours that the values of an image stand for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ColorProfile {
    /// The image has no profile, or linear values: EXR, NPY and TIFF of floats.
    None,
    /// The image has a profile that leaves its values as they are, to about one step of 8 bits.
    Srgb,
    /// Values are converted to sRGB when the image is read. This is the name of the profile.
    Converted(String),
    /// The image has a profile that cannot be applied: its values are taken as sRGB. This says why.
    Unknown(String),
}

/// The colour profile of an image, which [`read_image`](crate::read_image) and the other functions
/// apply: that of a PNG, JPEG, TIFF or WebP file, or Adobe RGB in the EXIF block of a JPEG file.
///
/// Reads the start of the file where the profile is there. An image that cannot be read has no
/// profile.
pub fn color_profile(path: &Path) -> ColorProfile {
    profile_of(path).map_or(ColorProfile::None, |plan| plan.describe())
}

/// See [`color_profile`].
fn profile_of(path: &Path) -> Option<Plan> {
    if extension(path) == "npy" {
        return None;
    }
    let (mut file, _) = open(path, "image", IMAGE).ok()?;
    let mut head = Vec::new();
    file.by_ref().take(HEAD).read_to_end(&mut head).ok()?;
    if raw::is_tiff(&head) {
        let head = tiff_read::head(path).ok()?;
        return head.is_integer.then(|| Plan::of(Ok(head.profile), head.has_color));
    }
    if head.starts_with(b"\xff\xd8") {
        let bytes =
            if jpeg::has_headers(&head) { head } else { read(path, "image", IMAGE).ok()? };
        let reader = ImageReader::new(std::io::Cursor::new(&bytes)).with_guessed_format().ok()?;
        let mut decoder = reader.into_decoder().ok()?;
        return Some(Plan::of_jpeg(&bytes, &mut decoder));
    }
    file.rewind().ok()?;
    let reader: ImageReader<BufReader<File>> = ImageReader::new(BufReader::new(file));
    let mut decoder = reader.with_guessed_format().ok()?.into_decoder().ok()?;
    Some(Plan::of_decoder(&mut decoder))
}

/// The conversion of the pixels of an image.
pub(crate) enum Plan {
    /// None is needed or possible.
    Keep(ColorProfile),
    /// From this profile, which has this name.
    Convert(Box<moxcms::ColorProfile>, String),
}

impl Plan {
    /// The conversion of the image of a decoder that knows its profile.
    pub(crate) fn of_decoder(decoder: &mut impl ImageDecoder) -> Self {
        let profile = decoder.icc_profile().map_err(|error| error.to_string());
        Plan::of(profile, decoder.color_type().has_color())
    }

    /// The conversion of a JPEG image with this content.
    pub(crate) fn of_jpeg(bytes: &[u8], decoder: &mut impl ImageDecoder) -> Self {
        let profile = jpeg::color_profile(bytes);
        let block = decoder.exif_metadata().ok().flatten();
        if profile == Ok(None) && block.is_some_and(|block| exif::is_adobe_rgb(&block)) {
            let name = "Adobe RGB (EXIF)".to_owned();
            return Plan::Convert(Box::new(moxcms::ColorProfile::new_adobe_rgb()), name);
        }
        Plan::of(profile, decoder.color_type().has_color())
    }

    /// The conversion of an image with this profile, or with the reason why it has none.
    pub(crate) fn of(profile: Result<Option<Vec<u8>>, String>, has_color: bool) -> Self {
        let unknown = |why: String| Plan::Keep(ColorProfile::Unknown(why));
        let bytes = match profile {
            Ok(Some(bytes)) => bytes,
            Ok(None) => return Plan::Keep(ColorProfile::None),
            Err(why) => return unknown(format!("a damaged profile ({})", printable(&why))),
        };
        let profile = match moxcms::ColorProfile::new_from_slice(&bytes) {
            Ok(profile) => profile,
            Err(error) => return unknown(format!("a damaged profile ({error})")),
        };
        let name = name_of(&profile);
        match profile.color_space {
            DataColorSpace::Rgb => {}
            DataColorSpace::Gray if !has_color => {}
            other => return unknown(format!("{name}, a profile of {other:?} values")),
        }
        match changes(&profile, has_color) {
            Err(error) => unknown(format!("{name} ({error})")),
            Ok([_, white]) if white > WHITE => unknown(format!("{name}, which changes white")),
            Ok([most, _]) if most <= SAME => Plan::Keep(ColorProfile::Srgb),
            Ok(_) => Plan::Convert(Box::new(profile), name),
        }
    }

    fn describe(self) -> ColorProfile {
        match self {
            Plan::Keep(profile) => profile,
            Plan::Convert(_, name) => ColorProfile::Converted(name),
        }
    }

    /// Converts the pixels of an image. Alpha stays as it is, and colours that sRGB cannot show
    /// become the nearest values.
    pub(crate) fn apply(&self, image: &mut DynamicImage) {
        let Plan::Convert(profile, _) = self else { return };
        // The profile was tried before: an error leaves the values as they are.
        let _ = match image {
            DynamicImage::ImageLuma8(image) => convert_grey(profile, image, 1),
            DynamicImage::ImageLumaA8(image) => convert_grey(profile, image, 2),
            DynamicImage::ImageRgb8(image) => convert_rgb(profile, image, 3),
            DynamicImage::ImageRgba8(image) => convert_rgb(profile, image, 4),
            DynamicImage::ImageLuma16(image) => convert_grey(profile, image, 1),
            DynamicImage::ImageLumaA16(image) => convert_grey(profile, image, 2),
            DynamicImage::ImageRgb16(image) => convert_rgb(profile, image, 3),
            DynamicImage::ImageRgba16(image) => convert_rgb(profile, image, 4),
            _ => Ok(()),
        };
    }
}

/// The name of a profile, for messages.
fn name_of(profile: &moxcms::ColorProfile) -> String {
    let name = match &profile.description {
        Some(ProfileText::PlainString(text)) => text.as_str(),
        Some(ProfileText::Localizable(texts)) => texts.first().map_or("", |text| &text.value),
        Some(ProfileText::Description(text)) => &text.ascii_string,
        None => "",
    };
    let name: String = name.trim_matches(['\0', ' ']).chars().take(LONGEST_NAME).collect();
    if name.is_empty() {
        "a profile without a name".to_owned()
    } else {
        printable(&name).to_string()
    }
}

/// The largest change of a value of 8 bits by a profile, and that of white.
fn changes(profile: &moxcms::ColorProfile, has_color: bool) -> Result<[u8; 2], CmsError> {
    let change = |from: &[u8], to: &[u8]| {
        from.iter().zip(to).map(|(from, to)| from.abs_diff(*to)).max().unwrap_or(0)
    };
    if !has_color {
        let table = grey_table::<u8>(profile)?;
        let same: Vec<u8> = (0..=u8::MAX).collect();
        let ends = [same[0].abs_diff(table[0]), same[255].abs_diff(table[255])];
        return Ok([change(&same, &table), ends[0].max(ends[1])]);
    }
    let steps = || (0..=u8::MAX).step_by(32).chain([u8::MAX]);
    let greys = (0..=u8::MAX).map(|v| [v; 3]);
    let colors = steps().flat_map(|r| steps().flat_map(move |g| steps().map(move |b| [r, g, b])));
    let from: Vec<[u8; 3]> = colors.chain(greys).collect();
    let mut to = from.clone();
    let executor = u8::executor(profile, Layout::Rgb, Layout::Rgb)?;
    executor.transform(from.as_flattened(), to.as_flattened_mut())?;
    let white = to.last().map_or(0, |white| change(&[u8::MAX; 3], white));
    Ok([change(from.as_flattened(), to.as_flattened()), white])
}

/// A conversion of pixels.
type Executor<T> = Arc<dyn TransformExecutor<T> + Send + Sync>;

/// A type of samples.
trait Sample: Copy + Default + 'static {
    /// All values in order.
    fn all() -> Vec<Self>;

    fn index(self) -> usize;

    /// The conversion from a profile to sRGB.
    fn executor(
        profile: &moxcms::ColorProfile,
        from: Layout,
        to: Layout,
    ) -> Result<Executor<Self>, CmsError>;
}

/// The values of a photograph are those of light: white stays white, and no contrast is added, as
/// far as the profile has such a table. A profile without tables has one meaning.
fn options(profile: &moxcms::ColorProfile) -> TransformOptions {
    let rendering_intent = match profile {
        moxcms::ColorProfile { lut_a_to_b_colorimetric: Some(_), .. } => {
            RenderingIntent::RelativeColorimetric
        }
        moxcms::ColorProfile { lut_a_to_b_perceptual: Some(_), .. } => RenderingIntent::Perceptual,
        moxcms::ColorProfile { lut_a_to_b_saturation: Some(_), .. } => RenderingIntent::Saturation,
        _ => RenderingIntent::RelativeColorimetric,
    };
    TransformOptions { rendering_intent, prefer_fixed_point: false, ..TransformOptions::default() }
}

impl Sample for u8 {
    fn all() -> Vec<u8> {
        (0..=u8::MAX).collect()
    }

    fn index(self) -> usize {
        self.into()
    }

    fn executor(
        profile: &moxcms::ColorProfile,
        from: Layout,
        to: Layout,
    ) -> Result<Executor<u8>, CmsError> {
        profile.create_transform_8bit(from, &moxcms::ColorProfile::new_srgb(), to, options(profile))
    }
}

impl Sample for u16 {
    fn all() -> Vec<u16> {
        (0..=u16::MAX).collect()
    }

    fn index(self) -> usize {
        self.into()
    }

    fn executor(
        profile: &moxcms::ColorProfile,
        from: Layout,
        to: Layout,
    ) -> Result<Executor<u16>, CmsError> {
        profile.create_transform_16bit(
            from,
            &moxcms::ColorProfile::new_srgb(),
            to,
            options(profile),
        )
    }
}

/// The converted value of each grey value.
fn grey_table<T: Sample>(profile: &moxcms::ColorProfile) -> Result<Vec<T>, CmsError> {
    let mut from = T::all();
    let mut layout = Layout::Gray;
    if profile.color_space == DataColorSpace::Rgb {
        // A photograph that was made grey may keep its profile.
        from = from.into_iter().flat_map(|value| [value; 3]).collect();
        layout = Layout::Rgb;
    }
    let mut to = vec![T::default(); 3 * T::all().len()];
    T::executor(profile, layout, Layout::Rgb)?.transform(&from, &mut to)?;
    Ok(to.as_chunks().0.iter().map(|[_, green, _]| *green).collect())
}

/// Converts grey pixels of this number of channels; the first is the grey value.
fn convert_grey<T: Sample>(
    profile: &moxcms::ColorProfile,
    samples: &mut [T],
    channels: usize,
) -> Result<(), CmsError> {
    let table = grey_table::<T>(profile)?;
    for value in samples.iter_mut().step_by(channels) {
        *value = table[value.index()];
    }
    Ok(())
}

/// Converts colours with three channels, or with alpha as a fourth.
fn convert_rgb<T: Sample>(
    profile: &moxcms::ColorProfile,
    samples: &mut [T],
    channels: usize,
) -> Result<(), CmsError> {
    let layout = if channels == 3 { Layout::Rgb } else { Layout::Rgba };
    let executor = T::executor(profile, layout, layout)?;
    let mut from = Vec::with_capacity(AT_ONCE * channels);
    for to in samples.chunks_mut(AT_ONCE * channels) {
        from.clear();
        from.extend_from_slice(to);
        executor.transform(&from, to)?;
        if channels == 4 {
            let alphas = to.iter_mut().zip(&from).skip(3).step_by(4);
            alphas.for_each(|(to, from)| *to = *from);
        }
    }
    Ok(())
}
