//! Loading a data set: recognise, split, read the images.

use std::path::{Path, PathBuf};

use files::{InputError, check_memory};
use rayon::prelude::*;
use render::Camera;

use crate::readers::{Distortion, Recognised, UnreadView, dynamic, recognise};

use crate::masks::recognise_used;
use crate::split::{HeldOut, Placed, place};
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

/// Reads a data set: [`open`], then [`Unread::read`], without progress.
///
/// # Errors
/// As these.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Dataset, InputError> {
    open(path)?.read(options, &mut |_| {})
}

/// A data set whose images are not read yet.
#[derive(Debug)]
pub struct Unread {
    path: PathBuf,
    train: Vec<UnreadView>,
    test: Vec<UnreadView>,
    /// The rest; it has no views.
    recognised: Recognised,
}

/// Reads the cameras of a data set, and holds views out by [`HeldOut::Auto`]; see [`open_with`].
///
/// # Errors
/// As there.
pub fn open(path: &Path) -> Result<Unread, InputError> {
    open_with(path, HeldOut::Auto)
}

/// Reads the cameras of a data set and recognises its format ([`crate::readers::recognise`]).
///
/// `path` is the folder, or a `.json` or `.xml` camera file in it. Views are in the order of the
/// camera file, those of COLMAP in the order of their names. Views without an image are left out.
///
/// # Errors
/// If no format is recognised, if there are too few views to hold out that many, or if a file is
/// missing or wrong: an [`InputError`] with the file and the place in it.
pub fn open_with(path: &Path, held_out: HeldOut) -> Result<Unread, InputError> {
    let folder = match path.parent().filter(|_| path.is_file()) {
        Some(parent) if parent.as_os_str().is_empty() => Path::new("."),
        Some(parent) => parent,
        None => path,
    };
    let mut recognised = recognise(folder, path)?;
    let train = std::mem::take(&mut recognised.train);
    let own = recognised.test.take();
    let (train, test) = held_out.split(train, own).map_err(|most| {
        let expected = format!("at most {most}, because two or more are fitted");
        InputError::new(path, "held-out views", held_out, expected)
    })?;
    if train.is_empty() {
        return Err(InputError::new(path, "views", "none to fit", "two photographs or more"));
    }
    train.iter().chain(&test).try_for_each(|view| view.check_lens(path))?;
    Ok(Unread { path: path.to_owned(), train, test, recognised })
}

impl Unread {
    /// The widths and heights of the whole photographs in pixels: of the views to fit, and of those
    /// held out.
    pub fn sizes(&self) -> [Vec<[u32; 2]>; 2] {
        [&self.train, &self.test].map(|views| views.iter().map(UnreadView::size).collect())
    }

    /// The same views with the split of a run: `names` of those to fit, and of those held out, in
    /// this order. Views that came later are left out, with a note.
    ///
    /// # Errors
    /// If a view is missing: without it, the numbers of the others would be compared with those of
    /// the run as if nothing had changed.
    pub fn split_by_names(self, names: [&[String]; 2]) -> Result<Self, InputError> {
        let Unread { path, train, test, mut recognised } = self;
        let all = names.map(<[_]>::len).iter().sum::<usize>();
        let Placed { lists: [train, test], others, missing } =
            place([train, test], names, UnreadView::name);
        if let Some(name) = missing {
            let wanted = names.into_iter().flatten().filter(|other| **other == name).count();
            let found = match wanted {
                1 => format!("none with the name {name}"),
                n => format!("fewer than {n} with the name {name}"),
            };
            let expected = format!(
                "the {all} views that the run began with (bring the image back, or try `eval`, \
                 `mesh`, `render` or `report` with --dataset, which take the views that are there)"
            );
            return Err(InputError::new(&path, "views", found, expected));
        }
        let later = others.iter().map(Vec::len).sum::<usize>();
        if later > 0 {
            let text = "views added since the run began, and left out";
            recognised.notes.push(format!("{text}: {later}"));
        }
        Ok(Unread { path, train, test, recognised })
    }

    /// The same views, of a data set other than that of a run: those with `names` of the run are to
    /// fit or held out as there. The others stay as they are.
    #[must_use]
    pub fn split_like(self, names: [&[String]; 2]) -> Self {
        let Unread { path, train, test, recognised } = self;
        let Placed { lists, others, .. } = place([train, test], names, UnreadView::name);
        let [mut train, mut test] = lists;
        let [other_train, other_test] = others;
        train.extend(other_train);
        test.extend(other_test);
        Unread { path, train, test, recognised }
    }

    /// The distortion of the lenses, which is removed when the images are read.
    pub fn distortion(&self) -> Distortion {
        Distortion::of(self.train.iter().chain(&self.test))
    }

    /// The folder or the file that it was opened by.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The cameras of the views to fit, and then of those held out, as the data set has them: with
    /// the lens of the photograph, without its distortion.
    pub fn cameras_as_read(&self) -> impl Iterator<Item = &Camera> {
        self.train.iter().chain(&self.test).map(UnreadView::camera)
    }

    /// The pinhole cameras of the views to fit, without reading their images.
    ///
    /// # Errors
    /// If the distortion of a lens cannot be removed.
    pub fn cameras(&self) -> Result<Vec<Camera>, InputError> {
        self.train.iter().map(UnreadView::pinhole).collect()
    }

    /// Reads the images. Lens distortion and skew are removed from the photographs, so every view
    /// has a pinhole camera.
    ///
    /// Images are read in parallel, as many at a time as fit in 512 MiB with the samples of their
    /// files, or as films where lenses have distortion, at least one. The result does not depend on
    /// the number of threads. `progress` gets the share of the images that are read.
    ///
    /// # Errors
    /// If a file is missing or wrong, or if `downscale` is 0: an [`InputError`] with the file and
    /// the place in it.
    pub fn read(
        self,
        options: &LoadOptions,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Dataset, InputError> {
        let Unread { path, train, test, recognised } = self;
        let n = options.downscale;
        if n == 0 {
            return Err(InputError::new(path, "downscale", 0, "1 or more"));
        }
        refuse_too_many(&path, [&train, &test], n)?;
        let is_dynamic = [dynamic(&train), dynamic(&test)].concat();
        let (of_train, all) = (train.len(), (train.len() + test.len()) as f64);
        let train = read_all(train, n, &mut |done| progress(done as f64 / all))?;
        let test = read_all(test, n, &mut |done| progress((of_train + done) as f64 / all))?;
        let Recognised { format, bounds, points, is_sure, notes, .. } = recognised;
        let mut dataset = Dataset { path, format, train, test, bounds, points, is_sure, notes };
        recognise_used(&mut dataset, &is_dynamic);
        Ok(dataset)
    }
}

/// Bytes of memory for each pixel of a view: an image in single precision and a mask.
const MEMORY_PER_PIXEL: u64 = 16;

/// Refuses images that need more memory than there is.
fn refuse_too_many(path: &Path, views: [&[UnreadView]; 2], n: u32) -> Result<(), InputError> {
    let pixels = views.iter().copied().flatten().fold(0, |sum: u64, view| {
        let [width, height] = view.size().map(|side| u64::from(side.div_ceil(n)));
        sum + width * height
    });
    check_memory(path, "images", format!("{pixels} pixels"), pixels * MEMORY_PER_PIXEL)
}

/// The memory for images of full size while they are read, in bytes.
const READING_MEMORY: u64 = 512 << 20;

/// Reads the images in parallel, one group after the other. Of several errors, the first in the
/// order of the views is returned, so that the message does not depend on timing. `report` gets the
/// number of images that are read.
fn read_all(
    mut views: Vec<UnreadView>,
    downscale: u32,
    report: &mut dyn FnMut(usize),
) -> Result<Vec<View>, InputError> {
    let mut read = Vec::with_capacity(views.len());
    let memory: Vec<u64> = views.iter().map(|view| view.reading_memory(downscale)).collect();
    for length in groups(&memory) {
        let group: Vec<_> = views.drain(..length).collect();
        let group: Vec<_> = group.into_par_iter().map(|view| view.read(downscale)).collect();
        read.extend(group.into_iter().collect::<Result<Vec<_>, _>>()?);
        report(read.len());
    }
    Ok(read)
}

/// The lengths of consecutive groups that need [`READING_MEMORY`] at most, or have one image.
/// `memory` is that of each image.
fn groups(memory: &[u64]) -> Vec<usize> {
    let mut groups: Vec<usize> = Vec::new();
    let mut left = 0;
    for &bytes in memory {
        match groups.last_mut().filter(|_| bytes <= left) {
            Some(last) => (*last, left) = (*last + 1, left - bytes),
            None => {
                groups.push(1);
                left = READING_MEMORY.saturating_sub(bytes);
            }
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_in_flight_stay_within_the_memory() {
        let mib = |sizes: &[u64]| sizes.iter().map(|n| n << 20).collect::<Vec<_>>();
        assert_eq!(groups(&mib(&[186; 5])), [2, 2, 1]);
        assert_eq!(groups(&mib(&[512, 512, 1, 511, 1])), [1, 1, 2, 1]);
        assert_eq!(groups(&mib(&[9000, 1, 9000, 9000])), [1, 1, 1, 1]);
        assert_eq!(groups(&[0; 1000]), [1000]);
        assert_eq!(groups(&[u64::MAX, u64::MAX]), [1, 1]);
        assert!(groups(&[]).is_empty());
    }
}
