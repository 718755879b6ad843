//! The notes that every format has: missing images, reduced images, orientations, fisheye lenses.

use std::path::{Path, PathBuf};

use crate::readers::UnreadView;
use crate::readers::lookup::file_name;
use crate::readers::recognised::Recognised;
use crate::readers::result::Result;
use files::{InputError, printable};
use film::{ColorProfile, TurnedByExif, color_profile, turned_by_exif};
use rayon::prelude::*;

/// Files that a note names.
const NAMED: usize = 3;

/// The most characters of a note.
const MAX_NOTE_CHARACTERS: usize = 400;

/// Adds the notes on missing images, reduced images, orientations and fisheye lenses.
///
/// # Errors
/// If more than half of the images to fit are missing; `path` is the data set.
pub(crate) fn add(recognised: &mut Recognised, path: &Path) -> Result<()> {
    let missing = missing(recognised, path)?;
    let unposed = unposed(recognised, path)?;
    let notes = [
        missing,
        unposed,
        scaled(recognised.views()),
        reduced(recognised.views()),
        resized_masks(recognised.views()),
        profiles(recognised.views()),
        orientations(recognised.views()),
        fisheye(recognised.views()),
    ];
    recognised.notes.extend(notes.into_iter().flatten());
    // Notes have names from files.
    for note in &mut recognised.notes {
        *note = printable(note).chars().take(MAX_NOTE_CHARACTERS).collect();
    }
    Ok(())
}

/// The note on missing images.
fn missing(recognised: &Recognised, path: &Path) -> Result<Option<String>> {
    let Recognised { train, missing, missing_test, .. } = recognised;
    if train.len() < missing.len() {
        let (all, first) = (train.len() + missing.len(), missing[0].display());
        let text = format!("{} of {all} missing: no such file {first}", missing.len());
        return Err(InputError::new(path, "images", text, "at least half of the images"));
    }
    let missing: Vec<&PathBuf> = missing.iter().chain(missing_test).collect();
    if missing.is_empty() {
        return Ok(None);
    }
    let all = train.len() + recognised.test.as_ref().map_or(0, Vec::len) + missing.len();
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(path) };
    let names = first_of(&missing, |image| relative(image, folder));
    let (count, verb) = (missing.len(), if missing.len() == 1 { "is" } else { "are" });
    Ok(Some(format!("{count} of {all} images {verb} missing and left out: {names}")))
}

/// A path relative to a folder, if it is in it.
pub(crate) fn relative(path: &Path, folder: &Path) -> String {
    path.strip_prefix(folder).unwrap_or(path).display().to_string()
}

/// The names of the first of these items, for a note.
pub(crate) fn first_of<T>(items: &[T], name: impl FnMut(&T) -> String) -> String {
    let names: Vec<String> = items.iter().take(NAMED).map(name).collect();
    let more = if items.len() > NAMED { ", …" } else { "" };
    format!("{}{more}", names.join(", "))
}

/// The note on images without a usable pose.
fn unposed(recognised: &Recognised, path: &Path) -> Result<Option<String>> {
    let Recognised { train, unposed, test, .. } = recognised;
    let Some(first) = unposed.first() else { return Ok(None) };
    let (count, all) = (unposed.len(), train.len() + test.as_ref().map_or(0, Vec::len));
    if train.len() < count {
        let (first, all) = (file_name(first), all + count);
        let found = format!("{count} of {all} without a pose of finite numbers: {first}, …");
        return Err(InputError::new(path, "poses", found, "at least half of the poses"));
    }
    let names = first_of(unposed, |image| file_name(image));
    let (have, are) = if count == 1 { ("image has", "is") } else { ("images have", "are") };
    Ok(Some(format!(
        "{count} {have} no usable pose (null, singular or not finite) and {are} left out: {names}"
    )))
}

/// The note on poses whose rotations have a scale.
fn scaled<'a>(views: impl Iterator<Item = &'a UnreadView>) -> Option<String> {
    let mut all = views.filter(|view| (view.pose_scale - 1.0).abs() > 0.0);
    let first = all.next()?;
    let (count, scale) = (1 + all.count(), first.pose_scale);
    Some(format!(
        "rotations with a uniform scale, which is divided out: {count}. That of {} has {}",
        first.name,
        files::length(scale, scale)
    ))
}

/// The note on images smaller than those of the camera file.
fn reduced<'a>(mut views: impl Iterator<Item = &'a UnreadView>) -> Option<String> {
    let (view, [from, to]) = views.find_map(|view| Some((view, [view.full_size?, view.size()])))?;
    let folder = view.path.parent().and_then(Path::file_name).unwrap_or_default();
    Some(format!(
        "images of the folder {} are {} than in the camera file: the intrinsics are scaled from \
         {} x {} to {} x {} pixels",
        folder.display(),
        if to < from { "smaller" } else { "larger" },
        from[0],
        from[1],
        to[0],
        to[1],
    ))
}

/// The note on masks of another size than the photographs.
fn resized_masks<'a>(views: impl Iterator<Item = &'a UnreadView>) -> Option<String> {
    let mut all = views.filter_map(|view| Some((view, view.other_size_of_mask()?)));
    let (view, from) = all.next()?;
    let (count, to) = (1 + all.count(), view.size());
    Some(format!(
        "masks of another size than the photographs, and brought to their size: {count}. That of \
         {} has {} x {} pixels, and the photograph {} x {}",
        view.name, from[0], from[1], to[0], to[1],
    ))
}

/// The note on colour profiles that cannot be applied.
fn profiles<'a>(views: impl Iterator<Item = &'a UnreadView>) -> Option<String> {
    let views: Vec<&UnreadView> = views.collect();
    let why = |view: &&UnreadView| match color_profile(&view.path) {
        ColorProfile::Unknown(why) => Some((view.name.clone(), why)),
        ColorProfile::None | ColorProfile::Srgb | ColorProfile::Converted(_) => None,
    };
    let all: Vec<(String, String)> = views.par_iter().filter_map(why).collect();
    let (count, (first, why)) = (all.len(), all.first()?);
    let images = if count == 1 { "image has" } else { "images have" };
    Some(format!(
        "{count} {images} a colour profile that cannot be applied, and are taken as sRGB: {first} \
         ({why})"
    ))
}

/// The note on EXIF orientations of which the size cannot tell whether the cameras expect them.
fn orientations<'a>(views: impl Iterator<Item = &'a UnreadView>) -> Option<String> {
    let is_unknown = |view: &&UnreadView| match turned_by_exif(&view.path) {
        None => false,
        Some(TurnedByExif::OtherSize) => view.size_source.is_none(),
        Some(TurnedByExif::SameSize) => true,
    };
    let turned: Vec<_> = views.filter(is_unknown).collect();
    let (count, first) = (turned.len(), turned.first()?);
    let images = if count == 1 { "image has" } else { "images have" };
    Some(format!(
        "{count} {images} an EXIF orientation, and the size cannot tell whether the poses are for \
         the upright image: the pixels are read as stored. If the poses are for upright images, \
         turn the files first. The first one is {}",
        first.name,
    ))
}

/// The note on fisheye lenses, with the largest field of view that is kept.
fn fisheye<'a>(views: impl Iterator<Item = &'a UnreadView>) -> Option<String> {
    let mut kept: Option<[f64; 2]> = None;
    let mut last = None;
    for view in views.filter(|view| view.lens.is_fisheye()) {
        let camera = (view.camera.focal, view.camera.principal, view.size(), view.lens);
        // Photographs of one lens have one result.
        if last.replace(camera) == Some(camera) {
            continue;
        }
        if let Some(ideal) = view.lens.pinhole(&view.camera) {
            let angle = |length: u32, principal: f64, focal: f64| {
                let ends = [principal / focal, (f64::from(length) - principal) / focal];
                ends.map(f64::atan).iter().sum::<f64>().to_degrees()
            };
            let found = [
                angle(ideal.width, ideal.principal.x, ideal.focal.x),
                angle(ideal.height, ideal.principal.y, ideal.focal.y),
            ];
            let kept = kept.get_or_insert(found);
            *kept = [kept[0].max(found[0]), kept[1].max(found[1])];
        }
    }
    kept.map(|[x, y]| {
        format!(
            "photographs of a fisheye lens are made into pinhole images of {x:.0} x {y:.0} \
             degrees; the rest of each is cut off"
        )
    })
}
