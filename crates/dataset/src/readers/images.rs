//! Folders of images: their names, reduced copies, and the images of numbered cameras.

use std::path::{Component, Path, PathBuf};

use crate::readers::result::Result;
use files::InputError;
use film::refuse_unconverted;

/// Names of the folder of full images.
pub(crate) const FOLDERS: [&str; 2] = ["images", "input"];

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
    let full = places.iter().flat_map(|place| FOLDERS.map(|name| place.join(name)));
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
        return Err(InputError::new(folder, "images", "none", "PNG or JPEG files"));
    }
    Ok(images)
}

/// The PNG and JPEG files of a folder, in the order of their names.
pub(crate) fn images_in(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)?.flatten().map(|e| e.path()).collect();
    paths.retain(|p| {
        p.extension().is_some_and(|e| {
            ["png", "jpg", "jpeg"].contains(&e.to_string_lossy().to_lowercase().as_str())
        })
    });
    paths.sort();
    Ok(paths)
}

/// The image `name` in `folder`. Its extension may be missing in the name, or another one: for
/// example, HEIC files are converted after COLMAP has seen them. The copy then counts, not they.
pub(crate) fn image_named(folder: &Path, name: &str) -> Option<PathBuf> {
    let as_named = folder.join(name);
    let extensions = ["png", "jpg", "jpeg", "exr", "PNG", "JPG", "JPEG"];
    let added = extensions.map(|e| folder.join(format!("{name}.{e}")));
    let replaced = extensions.map(|e| as_named.with_extension(e));
    let is_converted = ["heic", "heif", "avif"].contains(&files::extension(&as_named).as_str());
    let (first, last) = if is_converted { (None, Some(as_named)) } else { (Some(as_named), None) };
    let places = first.into_iter().chain(added).chain(replaced).chain(last);
    places.into_iter().find(|p| p.is_file())
}

/// The path of [`image_named`], or of the missing image with this very name.
pub(crate) fn image_place(folder: &Path, name: &str) -> PathBuf {
    image_named(folder, name).unwrap_or_else(|| folder.join(name))
}

/// `masks/train/r_000.png` for `./train/r_000`, or else `masks/r_000.png`. For a name that is not
/// inside the folder, only the latter.
pub(crate) fn sibling_mask(folder: &Path, name: &str) -> Option<PathBuf> {
    let name = name.trim_start_matches("./");
    let file = name.rsplit_once('/').map_or(name, |(_, file)| file);
    let is_inside = Path::new(name).components().all(|c| matches!(c, Component::Normal(_)));
    let names = [Some(name).filter(|_| is_inside), Some(file)];
    names.into_iter().flatten().find_map(|n| image_named(&folder.join("masks"), n))
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

/// The last number in the name of a file, without its extension.
fn number(path: &Path) -> Option<usize> {
    let stem = path.file_stem()?.to_string_lossy().into_owned();
    let end = stem.trim_end_matches(|c: char| !c.is_ascii_digit());
    let start = end.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    end[start..].parse().ok()
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
