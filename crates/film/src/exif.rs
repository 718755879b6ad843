//! The focal length and the colours in the EXIF block of a photograph.
//!
//! The block is a TIFF file (TIFF 6.0, section 2; Exif 2.32, sections 4.6.2 and 4.6.5): a byte
//! order, the place of a list of entries, and entries of 12 bytes: a tag, a type, a count, and a
//! value or its place.

#![warn(clippy::cast_possible_truncation)]

/// The tag of the place of the list with the entries of the camera.
const EXIF: u16 = 0x8769;

/// The tag of the focal length in millimetres.
const FOCAL_LENGTH: u16 = 0x920a;

/// The tag of the focal length that has this field of view on film of 36 × 24 mm.
const FOCAL_LENGTH_35: u16 = 0xa405;

/// The tag of the place of the list that says how the photograph is exchanged.
const EXCHANGE: u16 = 0xa005;

/// The tag of the rule of exchange in it.
const RULE: u16 = 1;

/// The rule that stands for Adobe RGB (DCF 2.0; Exif 2.32, section 4.6.7).
const ADOBE_RGB: &[u8] = b"R03";

/// The focal length of the lens that took a photograph, from its EXIF block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FocalLength {
    /// In millimetres, as numerator and denominator.
    pub millimetres: Option<[u32; 2]>,
    /// In millimetres, for the same field of view on film of 36 × 24 mm.
    pub equivalent: Option<u16>,
}

/// A TIFF file with its byte order.
struct Tiff<'a> {
    bytes: &'a [u8],
    little: bool,
}

impl<'a> Tiff<'a> {
    fn u16(&self, at: usize) -> Option<u16> {
        let bytes = *self.bytes.get(at..)?.first_chunk()?;
        Some(if self.little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
    }

    fn u32(&self, at: usize) -> Option<u32> {
        let bytes = *self.bytes.get(at..)?.first_chunk()?;
        Some(if self.little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    /// The place of the value of an entry in the list at `list`.
    fn value(&self, list: usize, tag: u16) -> Option<usize> {
        let entries = (0..usize::from(self.u16(list)?)).map(|i| list + 2 + 12 * i);
        entries.into_iter().find(|at| self.u16(*at) == Some(tag)).map(|at| at + 8)
    }
}

/// An EXIF block, and the place of its list with the entries of the camera.
fn camera_list(block: &[u8]) -> Option<(Tiff<'_>, usize)> {
    let little = match block.get(..4)? {
        b"II*\0" => true,
        b"MM\0*" => false,
        _ => return None,
    };
    let tiff = Tiff { bytes: block, little };
    let list = tiff.u32(tiff.value(tiff.u32(4)? as usize, EXIF)?)? as usize;
    Some((tiff, list))
}

/// Whether an EXIF block says that the colours are those of Adobe RGB. Cameras say it there, and
/// some write no colour profile.
pub(crate) fn is_adobe_rgb(block: &[u8]) -> bool {
    let rule = camera_list(block).and_then(|(tiff, list)| {
        let exchange = tiff.u32(tiff.value(list, EXCHANGE)?)? as usize;
        block.get(tiff.value(exchange, RULE)?..)
    });
    rule.is_some_and(|rule| rule.starts_with(ADOBE_RGB))
}

/// The focal length in an EXIF block; `None` if it has none, or is damaged.
pub(crate) fn focal_length(block: &[u8]) -> Option<FocalLength> {
    let (tiff, list) = camera_list(block)?;
    let millimetres = tiff.value(list, FOCAL_LENGTH).and_then(|at| {
        let place = tiff.u32(at)? as usize;
        Some([tiff.u32(place)?, tiff.u32(place.checked_add(4)?)?])
    });
    let equivalent = tiff.value(list, FOCAL_LENGTH_35).and_then(|at| tiff.u16(at));
    (millimetres.is_some() || equivalent.is_some())
        .then_some(FocalLength { millimetres, equivalent })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block with the focal length 4.25 mm, equivalent to 26 mm.
    fn block(little: bool) -> Vec<u8> {
        let short = |v: u16| if little { v.to_le_bytes() } else { v.to_be_bytes() };
        let long = |v: u32| if little { v.to_le_bytes() } else { v.to_be_bytes() };
        let mut out = if little { b"II*\0".to_vec() } else { b"MM\0*".to_vec() };
        let entry = |out: &mut Vec<u8>, tag: u16, kind: u16, value: [u8; 4]| {
            out.extend([short(tag), short(kind)].concat());
            out.extend([long(1), value].concat());
        };
        out.extend(long(8));
        out.extend(short(1));
        entry(&mut out, EXIF, 4, long(26));
        out.extend(long(0));
        out.extend(short(2));
        entry(&mut out, FOCAL_LENGTH, 5, long(56));
        let [a, b] = short(26);
        entry(&mut out, FOCAL_LENGTH_35, 3, [a, b, 0, 0]);
        out.extend(long(0));
        out.extend([long(425), long(100)].concat());
        out
    }

    #[test]
    fn both_byte_orders_are_read_and_damage_is_no_error() {
        let expected = FocalLength { millimetres: Some([425, 100]), equivalent: Some(26) };
        for little in [true, false] {
            let block = block(little);
            assert_eq!(focal_length(&block), Some(expected));
            for end in 0..block.len() {
                // A shorter block has less, and none of another value.
                let found = focal_length(&block[..end]);
                assert!(found.is_none_or(|f| f.millimetres.is_none_or(|m| m == [425, 100])));
            }
            for at in 0..block.len() {
                let mut damaged = block.clone();
                damaged[at] = 0xff;
                let _ = focal_length(&damaged);
            }
        }
        assert_eq!(focal_length(b"no block"), None);
    }
}
