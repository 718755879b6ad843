//! HEIF files (HEIC and AVIF, the photographs of many phones): they are recognised, and refused
//! elsewhere.
//!
//! Such a file starts with a box of type `ftyp`: its length (four bytes, the highest first), its
//! type, the major brand, a version, and the compatible brands (ISO/IEC 14496-12, section 4.3;
//! ISO/IEC 23008-12, Annex B). Names and types have four letters.

#![warn(clippy::cast_possible_truncation)]

/// The brands of HEIF files, and the name of their format.
const BRANDS: [(&[u8; 4], &str); 12] = [
    (b"heic", "a HEIC image"),
    (b"heix", "a HEIC image"),
    (b"heim", "a HEIC image"),
    (b"heis", "a HEIC image"),
    (b"hevc", "a HEIC image"),
    (b"hevx", "a HEIC image"),
    (b"hevm", "a HEIC image"),
    (b"hevs", "a HEIC image"),
    (b"avif", "an AVIF image"),
    (b"avis", "an AVIF image"),
    // Any coding; after the others, which say more.
    (b"mif1", "a HEIF image"),
    (b"msf1", "a HEIF image"),
];

/// The number of bytes at the start of a file that are searched for brands. Files have about five.
const START: usize = 64;

/// The name of the format of a HEIF file, of which `start` is the beginning.
pub(crate) fn format(start: &[u8]) -> Option<&'static str> {
    BRANDS.into_iter().find_map(|(brand, format)| has_brand(start, brand).then_some(format))
}

/// Whether the box at the start of a file has this brand.
pub(crate) fn has_brand(start: &[u8], brand: &[u8; 4]) -> bool {
    let Some((length, rest)) = start.split_first_chunk() else { return false };
    let end = start.len().min(START).min(u32::from_be_bytes(*length) as usize);
    let brands = if end >= 8 && rest.starts_with(b"ftyp") { &start[8..end] } else { &[] };
    brands.chunks_exact(4).any(|found| found == brand)
}
