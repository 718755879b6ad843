//! Images of formats that are not read: they are recognised by their content and refused with the
//! name of a converter.

#![warn(clippy::cast_possible_truncation)]

use std::io::{Cursor, Read, Seek};
use std::path::{Path, PathBuf};

use files::{InputError, extension, open};

use crate::formats::{IMAGE, is_image_name};
use crate::{heif, raw};

/// The starts of files of other formats, and the names of these.
const STARTS: [(&[u8], &str); 14] = [
    (b"GIF8", "a GIF image"),
    (b"\xff\x0a", "a JPEG XL image"),
    (b"\0\0\0\x0cJXL \r\n\x87\n", "a JPEG XL image"),
    (b"\0\0\0\x0cjP  \r\n\x87\n", "a JPEG 2000 image"),
    (b"\xff\x4f\xff\x51", "a JPEG 2000 image"),
    (b"II\xbc\x01", "a JPEG XR image"),
    (b"8BPS", "a PSD image"),
    (b"8BPB", "a PSD image"),
    (b"#?RADIANCE", "a Radiance HDR image"),
    (b"#?RGBE", "a Radiance HDR image"),
    (b"DDS ", "a DDS image"),
    (b"qoif", "a QOI image"),
    (b"gimp xcf ", "an XCF image"),
    (b"farbfeld", "a farbfeld image"),
];

/// The number of bytes at the start of a file that tell its format. The names of HEIF files are
/// among about forty.
const START: usize = 64;

/// How an image is converted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Converter {
    Heif,
    Raw,
    Any,
}

impl Converter {
    /// The commands that convert the image `path`.
    fn commands(self, path: &Path) -> String {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let end = match self {
            Converter::Heif => "jpg",
            Converter::Raw => "tif",
            Converter::Any => "png",
        };
        // A converter must not overwrite its input.
        let end =
            if extension(path) == end { format!("-converted.{end}") } else { format!(".{end}") };
        match self {
            Converter::Heif => format!(
                "heif-convert {name} {stem}{end}, or on macOS by \
                 sips -s format jpeg {name} --out {stem}{end}"
            ),
            Converter::Raw => format!(
                "darktable-cli {name} {stem}{end}, by dcraw -w -T {name}, or on macOS by \
                 sips -s format tiff {name} --out {stem}{end}"
            ),
            Converter::Any => format!("magick {name} {stem}{end}"),
        }
    }
}

/// Refuses a file with this content if it has another format, whatever its extension is.
pub(crate) fn refuse(path: &Path, bytes: &[u8]) -> Result<(), InputError> {
    refuse_content(path, &bytes[..bytes.len().min(START)], Cursor::new(bytes))
}

/// Refuses a file that starts with `start` if it has another format, whatever its extension is.
pub(crate) fn refuse_content(
    path: &Path,
    start: &[u8],
    file: impl Read + Seek,
) -> Result<(), InputError> {
    let Some((format, converter)) = format(path, start, file) else { return Ok(()) };
    let expected = format!("{IMAGE}: convert it by {}", converter.commands(path));
    Err(InputError::new(path, "image", format, expected))
}

/// The name of the format of a file that is not read, and its converter.
fn format(path: &Path, start: &[u8], file: impl Read + Seek) -> Option<(&'static str, Converter)> {
    let of = |converter| move |format| (format, converter);
    if let Some(format) = heif::format(start) {
        return Some((format, Converter::Heif));
    }
    let is_cr3 = heif::has_brand(start, b"crx ");
    let raw = match raw::is_tiff(start) {
        true => raw::format_of_start(start).or_else(|| raw::format_of_tiff(path, file)),
        false => raw::format_of_start(start).or(is_cr3.then_some("a CR3 image")),
    };
    let by_start = || STARTS.into_iter().find_map(|(s, f)| start.starts_with(s).then_some(f));
    let others = [
        ("a BMP image", is_bmp as fn(&[u8]) -> bool),
        ("a PPM, PGM, PBM, PFM or PAM image", is_netpbm),
        ("a TGA image", is_tga),
    ];
    raw.map(of(Converter::Raw)).or_else(|| {
        by_start()
            .or_else(|| others.into_iter().find_map(|(name, is)| is(start).then_some(name)))
            .map(of(Converter::Any))
    })
}

/// BMP: two letters, the length of the file, and four bytes 0.
fn is_bmp(start: &[u8]) -> bool {
    start.starts_with(b"BM") && start.get(6..10) == Some(&[0; 4])
}

/// Formats of Netpbm: the letter P, one of 1 to 7, F or f, white space, and a number, a comment or
/// a word.
fn is_netpbm(start: &[u8]) -> bool {
    match start {
        [b'P', b'1'..=b'6' | b'F' | b'f', space, next, ..] => {
            space.is_ascii_whitespace() && (next.is_ascii_digit() || *next == b'#')
        }
        _ => start.starts_with(b"P7\nWIDTH") || start.starts_with(b"P7\n#"),
    }
}

/// TGA has no first bytes of its own: a length, kinds of the colour map and the image, the colour
/// map, the origin, the size, bits of a pixel, and flags.
fn is_tga(start: &[u8]) -> bool {
    let Some(&[_, map, kind, rest @ ..]) = start.first_chunk::<18>() else { return false };
    let [first_low, first_high, low, high, entry, ..] = rest;
    let is_map = match map {
        0 => [first_low, first_high, low, high, entry] == [0; 5],
        1 => [low, high] != [0, 0] && matches!(entry, 15 | 16 | 24 | 32),
        _ => false,
    };
    let is_kind = matches!((map, kind), (1, 1 | 9) | (0, 2 | 3 | 10 | 11));
    let has_size = rest[9..11] != [0; 2] && rest[11..13] != [0; 2];
    is_map && is_kind && has_size && matches!(rest[13], 8 | 15 | 16 | 24 | 32) && rest[14] < 64
}

/// Refuses a missing image `path` if a file of a format that is not read stands in its place: one
/// of the same name up to the extension, or any if its folder has no image that can be read. If
/// `path` is a folder, the files in it count.
///
/// Files whose place cannot be read are no reason for a refusal.
///
/// # Errors
/// With the first such file by name, and the name of a converter.
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
    if files.iter().any(|file| is_image_name(file)) {
        return Ok(());
    }
    files.iter().try_for_each(|file| refuse_file(file))
}

/// Refuses a file of another format by its content. Other files, also those that cannot be read,
/// are accepted.
fn refuse_file(path: &Path) -> Result<(), InputError> {
    let mut start = Vec::new();
    let Ok((mut file, _)) = open(path, "image", IMAGE) else { return Ok(()) };
    let read = file.by_ref().take(START as u64).read_to_end(&mut start);
    read.map_or(Ok(()), |_| refuse_content(path, &start, file))
}
