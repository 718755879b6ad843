//! Folders of images: their names, reduced copies, and the images of numbered cameras.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::readers::lookup::{FOLDERS, entries, file_name, folder_named, natural_order, number};
use crate::readers::mask_files::is_mask_of;
use crate::readers::result::Result;
use files::InputError;
use film::{is_photograph_name, refuse_unconverted};

/// The factors of reduced copies: `images_2` has half of the width and height of `images`.
const REDUCED: [u32; 3] = [2, 4, 8];

/// A folder of images.
pub(crate) struct ImageFolder {
    pub(crate) path: PathBuf,
    /// Whether the images are reduced copies: the camera file states another size.
    pub(crate) is_reduced: bool,
}

/// The folders `folder_2`, `folder_4` and `folder_8` that exist.
pub(crate) fn reduced_copies(folder: &Path) -> impl Iterator<Item = PathBuf> + use<> {
    let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let parent = folder.parent().unwrap_or(Path::new("")).to_owned();
    REDUCED.into_iter().map(move |n| parent.join(format!("{name}_{n}"))).filter(|p| p.is_dir())
}

/// The folder of images in one of these places: the first of full images that `has` says to be the
/// right one; else the first such of reduced images; else the first folder of images at all.
pub(crate) fn image_folder(places: &[&Path], has: impl Fn(&Path) -> bool) -> Option<ImageFolder> {
    let named = |place: &Path, name| folder_named(place, name).unwrap_or_else(|| place.join(name));
    let full = places.iter().flat_map(|place| FOLDERS.map(|name| named(place, name)));
    let full = full.collect::<Vec<_>>();
    let reduced = full.iter().flat_map(|folder| reduced_copies(folder)).map(|path| (path, true));
    let all = full.iter().map(|path| (path.clone(), false)).chain(reduced);
    let mut all = all.filter(|(path, _)| path.is_dir()).collect::<Vec<_>>();
    if all.is_empty() {
        return None;
    }
    let at = all.iter().position(|(path, _)| has(path)).unwrap_or(0);
    let (path, is_reduced) = all.swap_remove(at);
    Some(ImageFolder { path, is_reduced })
}

/// The images of a folder that must have some.
pub(crate) fn images(folder: &Path) -> Result<Vec<PathBuf>> {
    let images = images_in(folder)
        .map_err(|e| InputError::new(folder, "images", e, "a folder with images"))?;
    if images.is_empty() {
        refuse_unconverted(folder)?;
        return Err(InputError::new(folder, "images", "none", "PNG, JPEG, TIFF or WebP files"));
    }
    Ok(images)
}

/// The images of a folder, in the order of their names. Masks beside them are none.
pub(crate) fn images_in(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    std::fs::read_dir(folder)?;
    let mut paths = entries(folder);
    paths.retain(|path| is_photograph_name(path));
    let stems = paths.iter().filter_map(|path| path.file_stem());
    let stems: BTreeSet<String> = stems.map(|stem| stem.to_string_lossy().into_owned()).collect();
    paths.retain(|path| !is_mask_of(&file_name(path), &stems));
    Ok(paths)
}

/// Puts images, which are in the order of their names, into that in which numbers in names count as
/// numbers, and returns a note if that is another one.
pub(crate) fn by_number(images: &mut [PathBuf]) -> Option<String> {
    let before = images.to_vec();
    images.sort_by(|a, b| natural_order(&file_name(a), &file_name(b)));
    let (b, a) = before.iter().zip(&*images).find(|(before, after)| before != after)?;
    let (a, b) = (file_name(a), file_name(b));
    Some(format!(
        "images are paired with the cameras by their numbers: {a} comes before {b}, though not by \
         name. If the cameras are in the order of the names, rename the images with leading zeros"
    ))
}

/// The index of the camera of each image, in a set of `count` cameras whose file does not name the
/// images.
///
/// With one image a camera, they are in the order of the names. With fewer, the last number in each
/// name decides: from 0 on if there is an image 0, or over exactly `count` numbers. `None` if that
/// leaves a doubt.
pub(crate) fn positions(images: &[PathBuf], count: usize) -> Option<Vec<usize>> {
    if images.len() == count {
        return Some((0..count).collect());
    }
    let numbers = images.iter().map(|path| number(path)).collect::<Option<Vec<usize>>>()?;
    let (first, last) = (*numbers.iter().min()?, *numbers.iter().max()?);
    let mut different = numbers.clone();
    different.sort_unstable();
    different.dedup();
    let is_all = last - first < usize::MAX && last - first + 1 == count;
    let is_clear = (first == 0 && last < count) || is_all;
    (different.len() == images.len() && is_clear)
        .then(|| numbers.iter().map(|number| number - first).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_tell_the_cameras_of_images() {
        let paths = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        let of = |names: &[&str], count| positions(&paths(names), count);
        assert_eq!(of(&["b.png", "a.png"], 2), Some(vec![0, 1]));
        assert_eq!(of(&["000.png", "002.png"], 3), Some(vec![0, 2]));
        assert_eq!(of(&["IMG_7.png", "IMG_9_m.png"], 3), Some(vec![0, 2]));
        for doubtful in [&["1.png", "2.png"][..], &["0.png", "3.png"], &["a.png"], &["0.png"; 2]] {
            assert_eq!(of(doubtful, 3), None, "{doubtful:?}");
        }
        assert_eq!(of(&["99999999999999999999999.png"], 2), None);
        assert_eq!(of(&["0.png", "18446744073709551615.png"], 3), None);
    }
}
