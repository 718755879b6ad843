//! Loading a data set: recognise, split, read the images.

use std::path::Path;

use io::{InputError, check_memory};
use rayon::prelude::*;

use crate::readers::recognise;
use crate::split::every_eighth;
use crate::unread::UnreadView;
use crate::{Dataset, View};

/// Options of [`load`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoadOptions {
    /// Images are read at 1/`downscale` of their width and height; 1 or more.
    pub downscale: u32,
}

impl Default for LoadOptions {
    fn default() -> Self {
        LoadOptions { downscale: 1 }
    }
}

/// Reads a data set and recognises its format: NeRF/Blender, NeuS/IDR, Middlebury or COLMAP.
///
/// `path` is the folder, or a `.json` camera file in it. Views are in the order of the camera file,
/// those of COLMAP in the order of their names. Lens distortion and skew are removed from the
/// photographs, so every view has a pinhole camera. Images are read in parallel; the result does
/// not depend on the number of threads.
///
/// # Errors
/// If no format is recognised, if a file is missing or wrong, or if `downscale` is 0: an
/// [`InputError`] with the file and the place in it.
pub fn load(path: &Path, options: &LoadOptions) -> anyhow::Result<Dataset> {
    if options.downscale == 0 {
        return Err(InputError::new(path, "downscale", 0, "1 or more").into());
    }
    let folder = match path.parent().filter(|_| path.is_file()) {
        Some(parent) if parent.as_os_str().is_empty() => Path::new("."),
        Some(parent) => parent,
        None => path,
    };
    let recognised = recognise(folder, path)?;
    let (train, test) = match recognised.test {
        Some(test) => (recognised.train, test),
        None => every_eighth(recognised.train),
    };
    if train.is_empty() {
        return Err(InputError::new(path, "views", "none to fit", "two photographs or more").into());
    }
    refuse_too_many(path, [&train, &test], options.downscale)?;
    Ok(Dataset {
        path: path.to_owned(),
        format: recognised.format,
        train: read_all(train, options.downscale)?,
        test: read_all(test, options.downscale)?,
        bounds: recognised.bounds,
        points: recognised.points,
    })
}

/// Bytes of memory for each pixel of a view: an image in single precision and a mask.
const MEMORY_PER_PIXEL: u64 = 16;

/// Refuses images that need more memory than there is.
fn refuse_too_many(path: &Path, views: [&[UnreadView]; 2], n: u32) -> Result<(), InputError> {
    let pixels = views.iter().copied().flatten().fold(0, |sum: u64, UnreadView { camera, .. }| {
        sum + u64::from(camera.width.div_ceil(n)) * u64::from(camera.height.div_ceil(n))
    });
    check_memory(path, "images", format!("{pixels} pixels"), pixels * MEMORY_PER_PIXEL)
}

/// Reads the images in parallel. Of several errors, the first in the order of the views is
/// returned, so that the message does not depend on timing.
fn read_all(views: Vec<UnreadView>, downscale: u32) -> Result<Vec<View>, InputError> {
    let views: Vec<_> = views.into_par_iter().map(|view| view.read(downscale)).collect();
    views.into_iter().collect()
}
