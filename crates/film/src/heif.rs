//! HEIF files (HEIC and AVIF, the photographs of many phones): they are recognised and refused with
//! the name of a converter.
//!
//! Such a file starts with a box of type `ftyp`: its length (four bytes, the highest first), its
//! type, the major brand, a version, and the compatible brands (ISO/IEC 14496-12, section 4.3;
//! ISO/IEC 23008-12, Annex B). Names and types have four letters.

#![warn(clippy::cast_possible_truncation)]

use std::io::Read;
use std::path::{Path, PathBuf};

use files::{InputError, extension, open};

use crate::formats::{EXTENSIONS, IMAGE};

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

/// Refuses a file that starts with these bytes if it is a HEIF file, whatever its extension.
pub(crate) fn refuse(path: &Path, start: &[u8]) -> Result<(), InputError> {
    let Some(format) = format(start) else { return Ok(()) };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    // A converter must not overwrite its input.
    let end = if extension(path) == "jpg" { "-converted" } else { "" };
    let expected = format!(
        "{IMAGE}: convert it by heif-convert {name} {stem}{end}.jpg, or on macOS by \
         sips -s format jpeg {name} --out {stem}{end}.jpg"
    );
    Err(InputError::new(path, "image", format, expected))
}

/// The name of the format of a HEIF file, of which `start` is the beginning.
fn format(start: &[u8]) -> Option<&'static str> {
    let (length, rest) = start.split_first_chunk()?;
    let end = start.len().min(START).min(u32::from_be_bytes(*length) as usize);
    let brands = rest.strip_prefix(b"ftyp").filter(|_| end >= 8).map(|_| &start[8..end])?;
    let has = |brand: &[u8; 4]| brands.chunks_exact(4).any(|found| found == brand);
    BRANDS.into_iter().find_map(|(brand, format)| has(brand).then_some(format))
}

/// Refuses a missing image `path` if a HEIF file stands in its place: one of the same name up to
/// the extension, or any if its folder has no image that can be read. If `path` is a folder, the
/// files in it count.
///
/// Files whose place cannot be read are no reason for a refusal.
///
/// # Errors
/// With the first such file by name.
pub fn refuse_unconverted(path: &Path) -> Result<(), InputError> {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(path) };
    let here = Path::new(".");
    let entries = std::fs::read_dir(if folder.as_os_str().is_empty() { here } else { folder });
    let mut files: Vec<PathBuf> =
        entries.into_iter().flatten().flatten().map(|e| folder.join(e.file_name())).collect();
    files.sort();
    // The name in a camera file may lack the extension, and may have a dot for another reason.
    let names = [path.file_stem(), path.file_name()];
    let has_name = |file: &&PathBuf| !path.is_dir() && names.contains(&file.file_stem());
    files.iter().filter(has_name).try_for_each(|file| refuse_file(file))?;
    let is_readable = |file: &PathBuf| EXTENSIONS.contains(&extension(file).as_str());
    if files.iter().any(is_readable) {
        return Ok(());
    }
    files.iter().try_for_each(|file| refuse_file(file))
}

/// Refuses a HEIF file by its content. Other files, also those that cannot be read, are accepted.
fn refuse_file(path: &Path) -> Result<(), InputError> {
    let mut start = Vec::new();
    if let Ok((file, _)) = open(path, "image", IMAGE) {
        let read = file.take(START as u64).read_to_end(&mut start);
        return read.map_or(Ok(()), |_| refuse(path, &start));
    }
    Ok(())
}
