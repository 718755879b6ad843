//! Files by the names that people's camera files have for them.
//!
//! A name may come from another system (`images\a.jpg`), from another machine (a path that is gone
//! here), or from a file system that treats capitals and accents in another way. It is looked for
//! as it stands first.

use std::cmp::Ordering;
use std::path::{Component, Path, PathBuf};

use unicode_normalization::UnicodeNormalization;

/// Names of the folder of full images.
pub(crate) const FOLDERS: [&str; 2] = ["images", "input"];

/// Extensions of images, in the order in which they are tried.
const EXTENSIONS: [&str; 10] =
    ["png", "jpg", "jpeg", "exr", "PNG", "JPG", "JPEG", "tif", "tiff", "webp"];

/// Extensions of photographs that people convert: the copy counts, if there is one.
const CONVERTED: [&str; 14] = [
    "heic", "heif", "avif", "dng", "cr2", "cr3", "nef", "arw", "raf", "orf", "rw2", "bmp", "jxl",
    "gif",
];

/// A name without differences of capitals and of composed accents.
pub(crate) fn folded(name: &str) -> String {
    name.nfc().collect::<String>().to_lowercase()
}

/// Whether a file of this name is the companion that macOS writes beside it, or hidden.
pub(crate) fn is_hidden(name: &str) -> bool {
    name.starts_with('.')
}

/// The entries of a folder that are not hidden, in the order of their names; none if it cannot be
/// listed.
pub(crate) fn entries(folder: &Path) -> Vec<PathBuf> {
    let all = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let shown = all.filter(|entry| !is_hidden(&entry.file_name().to_string_lossy()));
    let mut paths: Vec<PathBuf> = shown.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

/// The last part of a path, as text.
pub(crate) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The folder `name` in `place`, or else the only one whose name differs by capitals or accents.
pub(crate) fn folder_named(place: &Path, name: &str) -> Option<PathBuf> {
    let exact = place.join(name);
    if exact.is_dir() {
        return Some(exact);
    }
    let wanted = folded(name);
    only(entries(place).into_iter().filter(|e| folded(&file_name(e)) == wanted && e.is_dir()))
}

/// The only item; `None` if there are several.
pub(crate) fn only<T>(mut items: impl Iterator<Item = T>) -> Option<T> {
    let first = items.next();
    first.filter(|_| items.next().is_none())
}

/// The image `name` in `folder`. Its extension may be missing in the name, or another one: for
/// example, HEIC files are converted after COLMAP has seen them. The copy then counts, not they.
///
/// If there is no such file, the name is read more loosely: `\` separates folders; leading folders
/// that are not in `folder` are dropped, those of an absolute path for example; `images/` and
/// `input/` are looked into; capitals and the composition of accents do not count, where one file
/// alone fits.
pub(crate) fn image_named(folder: &Path, name: &str) -> Option<PathBuf> {
    let slashed = || as_named(folder, &name.replace('\\', "/"));
    as_named(folder, name).or_else(slashed).or_else(|| loosely(folder, name))
}

/// The mask `name` in `folder`, read as loosely as [`image_named`] reads names, but in the last of
/// its folders: a photograph of the same name in another one is no mask.
pub(crate) fn mask_place(folder: &Path, name: &str) -> PathBuf {
    let loosely = || {
        let parts = parts(name);
        let least = parts.len().min(2);
        (0..=parts.len() - least).find_map(|i| along(folder, &parts[i..]))
    };
    as_named(folder, name).or_else(loosely).unwrap_or_else(|| folder.join(name))
}

/// The folders and the file of a name, without those that `..` leaves again.
fn parts(name: &str) -> Vec<&str> {
    let mut parts = Vec::new();
    for part in name.split(['/', '\\']).filter(|part| !part.is_empty() && *part != ".") {
        if part == ".." {
            parts.pop();
        } else {
            parts.push(part);
        }
    }
    parts
}

/// The path without `..`, if it is one of the same file.
fn direct(path: PathBuf) -> PathBuf {
    if !path.components().any(|part| part == Component::ParentDir) {
        return path;
    }
    let mut direct = PathBuf::new();
    for part in path.components() {
        match (part, direct.components().next_back()) {
            (Component::ParentDir, Some(Component::Normal(_))) => drop(direct.pop()),
            _ => direct.push(part),
        }
    }
    let same = |other: &PathBuf| {
        other.canonicalize().ok().is_some_and(|own| path.canonicalize().ok() == Some(own))
    };
    if same(&direct) { direct } else { path }
}

fn as_named(folder: &Path, name: &str) -> Option<PathBuf> {
    let path = folder.join(name);
    let added = EXTENSIONS.map(|e| folder.join(format!("{name}.{e}")));
    let replaced = EXTENSIONS.map(|e| path.with_extension(e));
    let is_converted = CONVERTED.contains(&files::extension(&path).as_str());
    let (first, last) = if is_converted { (None, Some(path)) } else { (Some(path), None) };
    let places = first.into_iter().chain(added).chain(replaced).chain(last);
    places.into_iter().find(|p| p.is_file()).map(direct)
}

fn loosely(folder: &Path, name: &str) -> Option<PathBuf> {
    let parts = parts(name);
    for (i, part) in parts.iter().enumerate() {
        if let Some(path) = along(folder, &parts[i..]) {
            return Some(path);
        }
        let is_doubled = parts.get(i + 1) == Some(part);
        if i + 1 < parts.len() && !is_doubled && folder_named(folder, part).is_some() {
            // The folder is there, and the image is not in it.
            return None;
        }
    }
    let mut places = FOLDERS.iter().filter_map(|name| folder_named(folder, name));
    places.find_map(|place| (0..parts.len()).find_map(|i| along(&place, &parts[i..])))
}

/// The image at the end of these folders, without differences of capitals and accents.
fn along(folder: &Path, parts: &[&str]) -> Option<PathBuf> {
    let (last, folders) = parts.split_last()?;
    let mut place = folder.to_owned();
    for name in folders {
        place = folder_named(&place, name)?;
    }
    as_named(&place, last).or_else(|| {
        let all: Vec<PathBuf> = entries(&place).into_iter().filter(|p| p.is_file()).collect();
        let wanted = folded(last);
        let of = |path: &&PathBuf| folded(&file_name(path));
        let same = all.iter().filter(|path| of(path) == wanted);
        let same_stem = all.iter().filter(|path| {
            let found = of(path);
            let stem = without_extension(&found);
            stem != found && (stem == wanted || stem == without_extension(&wanted))
        });
        only(same).or_else(|| only(same_stem)).cloned()
    })
}

/// Whether an extension is one of an image.
pub(crate) fn is_image(extension: &str) -> bool {
    EXTENSIONS.iter().any(|e| e.eq_ignore_ascii_case(extension))
}

/// A name without the extension of an image.
pub(crate) fn without_extension(name: &str) -> &str {
    name.rsplit_once('.').filter(|(_, e)| is_image(e)).map_or(name, |(stem, _)| stem)
}

/// Whether an extension is one of an image that people convert, or of an array.
pub(crate) fn is_foreign(extension: &str) -> bool {
    CONVERTED.contains(&extension) || extension == "npy"
}

/// The path of [`image_named`], or of the missing image with this very name.
pub(crate) fn image_place(folder: &Path, name: &str) -> PathBuf {
    image_named(folder, name).unwrap_or_else(|| folder.join(name))
}

/// The last number in the name of a file, without its extension.
pub(crate) fn number(path: &Path) -> Option<usize> {
    let stem = path.file_stem()?.to_string_lossy().into_owned();
    let end = stem.trim_end_matches(|c: char| !c.is_ascii_digit());
    let start = end.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    end[start..].parse().ok()
}

/// The order of names in which numbers count as numbers: `a9` comes before `a10`. Without numbers of
/// several lengths, it is that of the characters.
pub(crate) fn natural_order(a: &str, b: &str) -> Ordering {
    // A number without leading zeros, and what is behind it.
    let number = |name: &'_ str| -> Option<(usize, usize)> {
        let digits = name.bytes().take_while(u8::is_ascii_digit).count();
        let zeros = name.bytes().take(digits).take_while(|b| *b == b'0').count();
        (digits > 0).then_some((zeros, digits))
    };
    let (mut a_rest, mut b_rest) = (a, b);
    loop {
        let order = match (number(a_rest), number(b_rest)) {
            (Some((a_from, a_to)), Some((b_from, b_to))) => {
                let (a_number, b_number) = (&a_rest[a_from..a_to], &b_rest[b_from..b_to]);
                (a_rest, b_rest) = (&a_rest[a_to..], &b_rest[b_to..]);
                a_number.len().cmp(&b_number.len()).then_with(|| a_number.cmp(b_number))
            }
            _ => {
                let (mut a_chars, mut b_chars) = (a_rest.chars(), b_rest.chars());
                let first = (a_chars.next(), b_chars.next());
                (a_rest, b_rest) = (a_chars.as_str(), b_chars.as_str());
                if first == (None, None) {
                    return a.cmp(b);
                }
                first.0.cmp(&first.1)
            }
        };
        if order != Ordering::Equal {
            return order;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_other_systems_and_machines_are_found_and_missing_images_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in [
            "Images/a.JPG",
            "Images/b\u{e9}.png",
            "Images/c.png",
            "Images/C.jpg",
            "train/x.png",
            "Images/cam/e.png",
        ] {
            std::fs::create_dir_all(at(name).parent().unwrap()).unwrap();
            std::fs::write(at(name), "").unwrap();
        }
        let cases = [
            ("images/a.jpg", Some("Images/a.JPG")),
            ("images\\A", Some("Images/a.JPG")),
            ("C:\\photos\\images\\a.jpg", Some("Images/a.JPG")),
            ("/gone/images/a.jpg", Some("Images/a.JPG")),
            ("/gone/a.jpg", Some("Images/a.JPG")),
            ("images/images/a.jpg", Some("Images/a.JPG")),
            ("a.jpg", Some("Images/a.JPG")),
            ("images/be\u{301}.png", Some("Images/b\u{e9}.png")),
            ("images/c.png", Some("Images/c.png")),
            ("Images/c.tif", Some("Images/c.png")),
            // The folder is there, and has no such image.
            ("train/a.jpg", None),
            ("images/d.png", None),
            ("../a.jpg", Some("Images/a.JPG")),
            ("..\\Images\\a.jpg", Some("Images/a.JPG")),
            ("x/../images/a.jpg", Some("Images/a.JPG")),
            ("../gone/images/a.jpg", Some("Images/a.JPG")),
            ("cam/e.png", Some("Images/cam/e.png")),
            ("/gone/cam/e.png", Some("Images/cam/e.png")),
            ("gone/train/../train/x.png", Some("train/x.png")),
            ("", None),
        ];
        for (name, expected) in cases {
            assert_eq!(image_named(folder.path(), name), expected.map(at), "{name}");
        }
    }

    #[test]
    fn a_photograph_is_no_mask_and_paths_have_no_detours() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["images/a.png", "Masks/b.PNG", "c.png"] {
            std::fs::create_dir_all(at(name).parent().unwrap()).unwrap();
            std::fs::write(at(name), "").unwrap();
        }
        let cases = [
            ("masks/a.png", None),
            ("/gone/masks/a.png", None),
            ("a.png", None),
            ("masks/b.png", Some("Masks/b.PNG")),
            ("/gone/data/masks/b", Some("Masks/b.PNG")),
            ("masks\\b.png", Some("Masks/b.PNG")),
            ("c.png", Some("c.png")),
        ];
        for (name, expected) in cases {
            let expected = expected.map_or(at(name), at);
            assert_eq!(mask_place(folder.path(), name), expected, "{name}");
        }
        let own = folder.path().file_name().unwrap().to_str().unwrap();
        let detour = format!("../{own}/images/a.png");
        assert_eq!(image_named(folder.path(), &detour), Some(at("images/a.png")));
        let beside = image_named(&at("Masks"), "..\\images\\a.png");
        assert_eq!(beside, Some(at("images/a.png")));
    }

    #[test]
    fn numbers_in_names_are_in_the_order_of_numbers() {
        let ordered = [
            "0_0.png",
            "0_1.png",
            "0_10.png",
            "1_0.png",
            "09.png",
            "9_.png",
            "10.png",
            "B2.png",
            "a.png",
            "a2b1.png",
            "a2b10.png",
            "a02c.png",
            "a10b2.png",
            "a99999999999999999999999.png",
            "b1.png",
        ];
        let mut names = ordered;
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, ordered);
        for name in ordered {
            assert_eq!(natural_order(name, name), Ordering::Equal);
        }
    }
}
