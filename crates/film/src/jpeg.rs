//! Where the first image of a JPEG file ends, and its colour profile.

#![warn(clippy::cast_possible_truncation)]

use std::borrow::Cow;

use crate::jpeg_scan;
use crate::jpeg_segments::{EOI, SOS, Segments};

/// The code of application data 2.
const APP2: u8 = 0xe2;

/// The start of each part of a colour profile; the number of the part, counted from 1, and the
/// number of all parts follow (ICC.1:2022, Annex B.4).
const ICC: &[u8] = b"ICC_PROFILE\0";

/// The first image of a JPEG file as a decoder needs it: without the data that follow it, as films
/// and further images do, and with its end. `None` if the image is cut short.
///
/// Decoders fill the missing part of a scan with grey and report no error.
pub(crate) fn whole_image(bytes: &[u8]) -> Option<Cow<'_, [u8]>> {
    let mut segments = Segments::of(bytes);
    let scans = segments.by_ref().filter(|segment| segment.code == SOS).count();
    match segments.end {
        Some(end) => (scans > 0).then_some(Cow::Borrowed(&bytes[..end])),
        // Some programs leave the end away. Then the scans tell whether the image is whole.
        None => jpeg_scan::end(bytes).map(|end| Cow::Owned([&bytes[..end], &[0xff, EOI]].concat())),
    }
}

/// Whether the headers of a JPEG file end within its first bytes `head`.
pub(crate) fn has_headers(head: &[u8]) -> bool {
    Segments::of(head).any(|segment| segment.code == SOS)
}

/// The colour profile of a JPEG file, put together from its parts.
///
/// # Errors
/// If a part is missing or is there twice.
pub(crate) fn color_profile(bytes: &[u8]) -> Result<Option<Vec<u8>>, String> {
    let mut parts: Vec<(u8, u8, &[u8])> = Segments::of(bytes)
        .take_while(|segment| segment.code != SOS)
        .filter(|segment| segment.code == APP2)
        .filter_map(|segment| segment.content.strip_prefix(ICC)?.split_first_chunk())
        .map(|(&[number, count], part)| (number, count, part))
        .collect();
    parts.sort_by_key(|part| part.0);
    let Some(&(_, count, _)) = parts.first() else { return Ok(None) };
    let numbers = parts.iter().map(|part| (part.0, part.1));
    if !numbers.eq((1..=count).map(|number| (number, count))) {
        return Err(format!("a profile with {} of {count} parts", parts.len()));
    }
    Ok(Some(parts.iter().flat_map(|part| part.2).copied().collect()))
}
