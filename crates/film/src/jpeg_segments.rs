//! The segments of a JPEG file (ITU-T T.81, Annex B).
//!
//! A segment starts with a marker: FF, which more bytes FF may precede, and a code. Most have a
//! length (two bytes, the highest first, which counts itself) and a content. The data of a scan
//! follow the segment SOS; there, FF 00 stands for the byte FF, and FF D0 to FF D7 separate parts.

#![warn(clippy::cast_possible_truncation)]

/// The code of the start of an image.
const SOI: u8 = 0xd8;

/// The code of the end of an image.
pub(crate) const EOI: u8 = 0xd9;

/// The code of the start of a scan.
pub(crate) const SOS: u8 = 0xda;

/// A segment with a content.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment<'a> {
    /// The code of its marker.
    pub(crate) code: u8,
    pub(crate) content: &'a [u8],
    /// The place in the file behind it: that of the data of a scan.
    pub(crate) end: usize,
}

/// The segments of the first image of a file.
#[derive(Clone, Debug)]
pub(crate) struct Segments<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Whether a scan has started.
    in_scans: bool,
    /// The place behind the marker of the image's end, once it was found.
    pub(crate) end: Option<usize>,
}

impl<'a> Segments<'a> {
    /// The segments of a file with this content, behind the start of its image.
    pub(crate) fn of(bytes: &'a [u8]) -> Self {
        Segments { bytes, at: 2, in_scans: false, end: None }
    }

    /// The code of the next marker. Bytes between segments and the data of scans are passed over.
    fn next_code(&mut self) -> Option<u8> {
        loop {
            let rest = self.bytes.get(self.at..)?;
            let marker = rest.iter().position(|byte| *byte == 0xff)?;
            let code = marker + rest[marker..].iter().position(|byte| *byte != 0xff)?;
            self.at += code + 1;
            match rest[code] {
                // A byte FF, an undefined code, or a marker without a content.
                0x00..=0xbf | 0xd0..=0xd7 => {}
                // Another image.
                SOI if self.in_scans => return None,
                SOI => {}
                found => return Some(found),
            }
        }
    }
}

impl<'a> Iterator for Segments<'a> {
    type Item = Segment<'a>;

    fn next(&mut self) -> Option<Segment<'a>> {
        while self.end.is_none() {
            let code = self.next_code()?;
            if code == EOI {
                self.end = Some(self.at);
                return None;
            }
            let length = self.bytes.get(self.at..).and_then(|rest| rest.first_chunk());
            let end = length.map_or(usize::MAX, |l| self.at + usize::from(u16::from_be_bytes(*l)));
            if let Some(content) = self.bytes.get(self.at + 2..end) {
                self.at = end;
                self.in_scans |= code == SOS;
                return Some(Segment { code, content, end });
            }
            // Damaged data of a scan may look like a segment that is longer than the file. A header
            // that is cut short must not be searched: it may hold a smaller image.
            if !self.in_scans && end > self.bytes.len() {
                return None;
            }
        }
        None
    }
}
