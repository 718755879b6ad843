//! The photographs of a folder.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use dataset::readers::is_mask_of;
use files::InputError;
use film::{
    FocalLength, check_image, focal_length, image_size, is_photograph_name, refuse_unconverted,
};
use serde::{Deserialize, Serialize};

/// The least number of photographs: two have no held-out view, and few points.
const MIN_PHOTOGRAPHS: usize = 3;

/// The expected content of the folder, for messages.
const EXPECTED: &str = "3 or more photographs as .jpg, .png, .tif or .webp files";

/// A file of a photograph. Files of the same name, length and checksum count as the same.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PhotoFile {
    /// Its name in the folder.
    pub(crate) name: String,
    /// Its length.
    pub(crate) bytes: u64,
    /// The checksum of its content.
    pub(crate) crc32: u32,
}

/// The photographs of a folder, in alphabetical order. Folders inside it are not searched.
#[derive(Clone, Debug)]
pub struct Photographs {
    pub(crate) folder: PathBuf,
    pub(crate) files: Vec<PhotoFile>,
    /// Width and height of each, in pixels as stored.
    pub(crate) sizes: Vec<[u32; 2]>,
    focals: Vec<Option<FocalLength>>,
    /// The names of other files with images that are not read.
    other: Vec<String>,
}

impl Photographs {
    /// Lists the photographs in `folder`, and reads their sizes and focal lengths. Hidden files are
    /// left out.
    ///
    /// # Errors
    /// If the folder cannot be listed or has fewer than 3 photographs, or if the start of one
    /// cannot be read, or if its name cannot be in a list of COLMAP.
    pub fn in_folder(folder: &Path) -> Result<Self, InputError> {
        let refused = |found: String| InputError::new(folder, "photographs", found, EXPECTED);
        let entries = match std::fs::read_dir(folder) {
            Ok(entries) => entries,
            Err(_) if folder.is_file() => return Err(refused("a file".to_owned())),
            Err(_) if !folder.exists() => return Err(refused("no such folder".to_owned())),
            Err(e) => return Err(refused(e.to_string())),
        };
        let mut names: Vec<_> = entries.flatten().map(|e| e.file_name()).collect();
        names.sort();
        let (mut files, mut other) = (Vec::new(), Vec::new());
        let stems: BTreeSet<String> = names
            .iter()
            .filter_map(|name| Path::new(name).file_stem()?.to_str())
            .map(str::to_owned)
            .collect();
        for name in names {
            let path = folder.join(&name);
            let shown = name.to_string_lossy().into_owned();
            if shown.starts_with('.') || !path.is_file() {
                continue;
            }
            if !is_photograph_name(&path) || is_mask_of(&shown, &stems) {
                other.push(shown);
                continue;
            }
            let (bytes, crc32) = length_and_checksum(&path)?;
            files.push(PhotoFile { name: checked(folder, &name)?, bytes, crc32 });
        }
        if files.is_empty() {
            refuse_unconverted(folder)?;
        }
        if files.len() < MIN_PHOTOGRAPHS {
            return Err(refused(found_in(folder, files.len(), &other)));
        }
        let paths = || files.iter().map(|file| folder.join(&file.name));
        let sizes: Result<Vec<[u32; 2]>, InputError> =
            paths().map(|path| image_size(&path).map(|(w, h)| [w, h])).collect();
        let (sizes, focals) = (sizes?, paths().map(|path| focal_length(&path)).collect());
        Ok(Photographs { folder: folder.to_owned(), files, sizes, focals, other })
    }

    /// The number of photographs.
    pub fn count(&self) -> usize {
        self.files.len()
    }

    /// The numbers of the photographs of each size and focal length, as far as their files tell, in
    /// the order of their first photographs.
    pub(crate) fn alike(&self) -> Vec<Vec<usize>> {
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for number in 0..self.count() {
            let lens = |i: usize| (self.sizes[i], self.focals[i]);
            match groups.iter_mut().find(|group| lens(group[0]) == lens(number)) {
                Some(group) => group.push(number),
                None => groups.push(vec![number]),
            }
        }
        groups
    }

    /// Decodes a photograph.
    ///
    /// # Errors
    /// If it cannot be decoded.
    pub(crate) fn decode(&self, number: usize) -> Result<(), InputError> {
        check_image(&self.folder.join(&self.files[number].name))
    }

    /// Whether all have one size.
    pub fn have_one_size(&self) -> bool {
        self.sizes.iter().all(|size| *size == self.sizes[0])
    }

    /// The largest number of pixels of a photograph whose longer side is at most `side`.
    pub(crate) fn most_pixels(&self, side: u32) -> u64 {
        let pixels = |[width, height]: [u32; 2]| {
            let (width, height) = (u64::from(width), u64::from(height));
            let longer = width.max(height);
            let scaled = |length: u64| length * u64::from(side).min(longer) / longer.max(1);
            scaled(width) * scaled(height)
        };
        self.sizes.iter().copied().map(pixels).max().unwrap_or(0)
    }

    /// One sentence about files that are left out, if there are any.
    pub fn left_out(&self) -> Option<String> {
        let first = self.other.first()?;
        let count = self.other.len();
        Some(format!("files left out that are no photographs: {count}; first: {first}"))
    }

    /// The names of photographs, one a line.
    pub(crate) fn list(&self, numbers: &[usize]) -> String {
        numbers.iter().map(|&number| format!("{}\n", self.files[number].name)).collect()
    }
}

/// A folder with too few photographs, in words.
fn found_in(folder: &Path, photographs: usize, other: &[String]) -> String {
    let mut found = match photographs {
        0 => "none".to_owned(),
        n => format!("{n}"),
    };
    if let Some(first) = other.first() {
        found += &format!(" ({} other files; first: {first})", other.len());
    }
    if let Some((count, inside)) = most_inside(folder) {
        let inside = inside.display();
        found += &format!(" (folders inside are not searched: {inside} has {count}, name it)");
    }
    found
}

/// The folder with the most photographs in a folder, and their number.
fn most_inside(folder: &Path) -> Option<(usize, PathBuf)> {
    let entries = |folder: &Path| std::fs::read_dir(folder).into_iter().flatten().flatten();
    let count = |path: &Path| entries(path).filter(|e| is_photograph_name(&e.path())).count();
    let inside = entries(folder).map(|e| e.path()).filter(|path| path.is_dir());
    let counts = inside.map(|path| (count(&path), path)).filter(|(count, _)| *count > 0);
    counts.max_by(|(a, first), (b, second)| a.cmp(b).then_with(|| second.cmp(first)))
}

/// The length of a file in bytes, and the checksum of its content.
fn length_and_checksum(path: &Path) -> Result<(u64, u32), InputError> {
    let bytes = files::read(path, "image", "a readable file")?;
    Ok((bytes.len() as u64, crc32fast::hash(&bytes)))
}

/// A name that can be a line of a list. COLMAP removes spaces around a line.
fn checked(folder: &Path, name: &std::ffi::OsStr) -> Result<String, InputError> {
    let is_line = |text: &&str| text.trim() == *text && !text.contains(['\n', '\r']);
    name.to_str().filter(is_line).map(str::to_owned).ok_or_else(|| {
        let expected = "a name in UTF-8 without line breaks and without spaces around it";
        InputError::new(folder.join(name), "name", name.to_string_lossy(), expected)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png(path: &Path, width: u32, height: u32) {
        image::GrayImage::new(width, height).save(path).unwrap();
    }

    #[test]
    fn photographs_are_listed_and_other_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for (name, width) in [("b.png", 40), ("a b.PNG", 40), ("c.png", 40), (".d.png", 7)] {
            png(&at(name).with_extension("png"), width, 30);
            if name.ends_with("PNG") {
                std::fs::rename(at(name).with_extension("png"), at(name)).unwrap();
            }
        }
        png(&at("b_mask.png"), 40, 30);
        std::fs::write(at("notes.txt"), "x").unwrap();
        let names = ["a.JPG", "b.jpeg", "c.tif", "d.TIFF", "e.webp", "f.png"];
        assert!(names.iter().all(|name| is_photograph_name(&at(name))));
        assert!(!is_photograph_name(&at("g.exr")));
        let found = Photographs::in_folder(folder.path()).unwrap();
        assert_eq!(found.list(&[0, 1, 2]), "a b.PNG\nb.png\nc.png\n");
        assert_eq!(found.alike(), [[0, 1, 2]]);
        assert!(found.left_out().unwrap().ends_with("2; first: b_mask.png"));
        assert_eq!((found.most_pixels(3200), found.most_pixels(20)), (1200, 300));
        png(&at("d.png"), 30, 40);
        let found = Photographs::in_folder(folder.path()).unwrap();
        assert_eq!(found.alike(), [vec![0, 1, 2], vec![3]]);
        assert!(!found.have_one_size());
        found.decode(2).unwrap();
        let whole = std::fs::read(at("c.png")).unwrap();
        std::fs::write(at("c.png"), &whole[..whole.len() - 20]).unwrap();
        let error = found.decode(2).unwrap_err().to_string();
        assert!(error.contains("c.png: image: found an image that is cut short"), "{error}");
    }

    #[test]
    fn a_folder_without_enough_photographs_is_refused_in_one_line() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let message = |path: &Path| Photographs::in_folder(path).unwrap_err().to_string();
        assert!(message(&at("none")).contains("found no such folder, expected 3 or more"));
        for name in ["images/a.png", "scans/a.png", "scans/b.png"] {
            std::fs::create_dir_all(at(name).parent().unwrap()).unwrap();
            png(&at(name), 4, 4);
        }
        std::fs::write(at("a.CR2"), "x").unwrap();
        let none = message(folder.path());
        assert!(none.contains("found none (1 other files; first: a.CR2)"), "{none}");
        std::fs::write(at("a.CR2"), b"II*\0\x10\0\0\0CR\x02\0").unwrap();
        let raw = message(folder.path());
        assert!(raw.contains("a.CR2: image: found a CR2 image"), "{raw}");
        assert!(raw.contains("darktable-cli a.CR2 a.tif"), "{raw}");
        assert!(none.contains("scans has 2, name it"), "{none}");
        png(&at("a.png"), 4, 4);
        png(&at("b.png"), 4, 4);
        assert!(message(folder.path()).contains("found 2 "));
        assert!(message(&at("a.png")).contains("found a file"));
        std::fs::write(at("c.jpg"), b"\0\0\0\x18ftypheic\0\0\0\0").unwrap();
        assert!(message(folder.path()).contains("HEIC"));
        std::fs::write(at("c.jpg"), "no photograph").unwrap();
        assert!(message(folder.path()).contains("c.jpg: image: found"));
    }
}
