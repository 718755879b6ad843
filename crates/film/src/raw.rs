//! Camera raw files: they are recognised, and refused elsewhere.
//!
//! Most are TIFF files (TIFF 6.0, section 2) whose photograph has a coding of its own, beside a
//! small picture that any program reads: read as TIFF files, they would give that picture.

#![warn(clippy::cast_possible_truncation)]

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use files::extension;

/// Starts of raw files that are no TIFF files, and the names of their formats.
const STARTS: [(&[u8], &str); 8] = [
    (b"FUJIFILMCCD-RAW", "a RAF image"),
    (b"II\x1a\0\0\0HEAPCCDR", "a CRW image"),
    (b"IIU\0", "an RW2 image"),
    (b"IIRO", "an ORF image"),
    (b"IIRS", "an ORF image"),
    (b"MMOR", "an ORF image"),
    (b"\0MRM", "an MRW image"),
    (b"FOVb", "an X3F image"),
];

/// Extensions of raw files that are TIFF files, makers as the files name them, and the formats.
const FORMATS: [(&str, &str, &str); 13] = [
    ("nef", "NIKON", "a NEF image"),
    ("nrw", "NIKON", "an NRW image"),
    ("arw", "SONY", "an ARW image"),
    ("sr2", "SONY", "an SR2 image"),
    ("cr2", "Canon", "a CR2 image"),
    ("pef", "PENTAX", "a PEF image"),
    ("pef", "RICOH", "a PEF image"),
    ("srw", "SAMSUNG", "an SRW image"),
    ("3fr", "Hasselblad", "a 3FR image"),
    ("iiq", "Phase One", "an IIQ image"),
    ("erf", "SEIKO EPSON", "an ERF image"),
    ("kdc", "EASTMAN KODAK", "a KDC image"),
    ("dng", "", "a DNG image"),
];

/// The most lists of entries that are searched, and the most entries of each.
const MOST: [usize; 2] = [16, 512];

/// Whether a file that starts with these bytes is a TIFF file.
pub(crate) fn is_tiff(start: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| start.starts_with(&magic[..]))
}

/// The name of the format of a raw file that starts with these bytes.
pub(crate) fn format_of_start(start: &[u8]) -> Option<&'static str> {
    if is_tiff(start) && start.get(8..10) == Some(b"CR") {
        return Some("a CR2 image");
    }
    STARTS.into_iter().find_map(|(magic, format)| start.starts_with(magic).then_some(format))
}

/// The name of the format of a TIFF file that is a raw file.
pub(crate) fn format_of_tiff(path: &Path, file: impl Read + Seek) -> Option<&'static str> {
    let found = Search::of(file).unwrap_or_default();
    if found.dng {
        return Some("a DNG image");
    }
    let extension = extension(path);
    let is_of = |(end, _, _): &&(&str, &str, &str)| extension == *end;
    let by_extension = FORMATS.iter().find(is_of).map(|(.., format)| *format);
    if by_extension.is_some() || !found.raw {
        return by_extension;
    }
    let maker = String::from_utf8_lossy(&found.maker).into_owned();
    let by_maker = FORMATS.iter().find(|(_, name, _)| !name.is_empty() && maker.starts_with(name));
    Some(by_maker.map_or("a camera raw image", |(.., format)| *format))
}

/// The entries of a TIFF file that tell raw files.
#[derive(Debug, Default)]
struct Search {
    /// Whether it has a version of DNG.
    dng: bool,
    /// Whether an image has the colours of a sensor or a coding of a camera.
    raw: bool,
    maker: Vec<u8>,
}

/// A TIFF file with its byte order.
struct Tiff<R> {
    file: R,
    little: bool,
}

impl<R: Read + Seek> Tiff<R> {
    /// Up to `most` bytes from the place `at` on.
    fn bytes(&mut self, at: u32, most: usize) -> Option<Vec<u8>> {
        self.file.seek(SeekFrom::Start(at.into())).ok()?;
        let mut bytes = Vec::new();
        self.file.by_ref().take(most as u64).read_to_end(&mut bytes).ok()?;
        Some(bytes)
    }

    fn u16(&self, bytes: &[u8], at: usize) -> Option<u16> {
        let pair = *bytes.get(at..)?.first_chunk()?;
        Some(if self.little { u16::from_le_bytes(pair) } else { u16::from_be_bytes(pair) })
    }

    fn u32(&self, bytes: &[u8], at: usize) -> Option<u32> {
        let four = *bytes.get(at..)?.first_chunk()?;
        Some(if self.little { u32::from_le_bytes(four) } else { u32::from_be_bytes(four) })
    }
}

impl Search {
    /// Searches the lists of entries of a file; `None` if its header is damaged.
    fn of(file: impl Read + Seek) -> Option<Self> {
        let mut tiff = Tiff { file, little: true };
        let header = tiff.bytes(0, 8)?;
        tiff.little = header.starts_with(b"II");
        if tiff.u16(&header, 2)? != 42 {
            return None;
        }
        let mut found = Search::default();
        let mut lists = vec![tiff.u32(&header, 4)?];
        let mut next = 0;
        while next < lists.len().min(MOST[0]) {
            let at = lists[next];
            next += 1;
            let Some(count) = tiff.bytes(at, 2).and_then(|bytes| tiff.u16(&bytes, 0)) else {
                continue;
            };
            let length = 12 * usize::from(count).min(MOST[1]);
            let list = tiff.bytes(at.saturating_add(2), length + 4).unwrap_or_default();
            for entry in list.get(..length).unwrap_or(&list).chunks_exact(12) {
                found.add(&mut tiff, entry, &mut lists);
            }
            lists.extend(tiff.u32(&list, length).filter(|at| *at > 0 && !lists.contains(at)));
        }
        Some(found)
    }

    /// Reads an entry: a tag, a type, a count, and a value or its place.
    fn add<R: Read + Seek>(&mut self, tiff: &mut Tiff<R>, entry: &[u8], lists: &mut Vec<u32>) {
        let (tag, short) = (tiff.u16(entry, 0), tiff.u16(entry, 8));
        let (count, value) = (tiff.u32(entry, 4).unwrap_or(0), tiff.u32(entry, 8).unwrap_or(0));
        match tag {
            Some(50706) => self.dng = true,
            // The colours of a sensor, and the codings of Nikon, Sony and Pentax.
            Some(262) => self.raw |= matches!(short, Some(32803 | 34892)),
            Some(259) => self.raw |= matches!(short, Some(34713 | 32767 | 65535)),
            Some(271) if count > 4 => self.maker = tiff.bytes(value, 16).unwrap_or_default(),
            // Places of further lists.
            Some(330) if count == 1 => lists.push(value),
            Some(330) => {
                let places = tiff.bytes(value, 4 * MOST[0]).unwrap_or_default();
                let count = usize::try_from(count).unwrap_or(usize::MAX);
                lists.extend((0..count.min(MOST[0])).filter_map(|i| tiff.u32(&places, 4 * i)));
            }
            _ => {}
        }
    }
}
