//! The views of a data set before their images are read: the result of every reader.

use std::path::PathBuf;

use field::Sphere;
use film::refuse_unconverted;
use glam::DVec3;

use crate::readers::result::Result;
use crate::readers::unread::UnreadView;
use files::InputError;

/// The content of a data set before its images are read.
#[derive(Debug, Default)]
pub struct Recognised {
    /// The format and camera convention, as text.
    pub format: String,
    /// Views to fit.
    pub train: Vec<UnreadView>,
    /// Held-out views; `None` if the data set has no split of its own.
    pub test: Option<Vec<UnreadView>>,
    /// The bounding sphere, if the data set has one.
    pub bounds: Option<Sphere<f64>>,
    /// Points on the scene's surfaces, if the data set has any.
    pub points: Vec<DVec3>,
    /// Whether each of them is sure; see [`Dataset::is_sure`](crate::Dataset::is_sure).
    pub is_sure: Vec<bool>,
    /// One sentence for each thing that a user should know: images that are missing, models that
    /// are not read, photographs that are cut.
    pub notes: Vec<String>,
    /// Images that the camera file names and that do not exist, but for those in `missing_test`.
    pub(super) missing: Vec<PathBuf>,
    /// The same, of the views to hold out.
    pub(super) missing_test: Vec<PathBuf>,
    /// Images without a usable pose.
    pub(super) unposed: Vec<PathBuf>,
    /// Whether the mask `a.jpg.png` tells which pixels of `a.jpg` to use, as COLMAP's masks do.
    pub(super) used_by_extension: bool,
    /// Whether masks without the names of the photographs are in their order.
    pub(super) pairs_by_order: bool,
}

impl Recognised {
    /// A data set of these views, without a split.
    pub(super) fn new(format: &str, views: Views) -> Self {
        let Views { found, missing, unposed } = views;
        Recognised {
            format: format.to_owned(),
            train: found,
            missing,
            unposed,
            ..Recognised::default()
        }
    }

    /// The views to fit, and those to hold out.
    pub(super) fn views(&self) -> impl Iterator<Item = &UnreadView> {
        self.train.iter().chain(self.test.iter().flatten())
    }

    /// See [`views`](Self::views).
    pub(super) fn views_mut(&mut self) -> impl Iterator<Item = &mut UnreadView> {
        self.train.iter_mut().chain(self.test.iter_mut().flatten())
    }

    /// A data set with a split of its own. With no image to hold out, the usual split is made.
    pub(super) fn with_split(format: &str, train: Views, test: Views) -> Self {
        let mut recognised = Recognised::new(format, train);
        recognised.missing_test = test.missing;
        recognised.unposed.extend(test.unposed);
        recognised.test = Some(test.found).filter(|found| !found.is_empty());
        recognised
    }
}

/// The views of a camera file whose images exist, and the images that do not.
#[derive(Default)]
pub(super) struct Views {
    pub(super) found: Vec<UnreadView>,
    pub(super) missing: Vec<PathBuf>,
    /// Images without a usable pose.
    pub(super) unposed: Vec<PathBuf>,
}

impl Views {
    /// Adds the view of an image, or the image to those that are missing or have no pose.
    /// `view` returns `None` without a usable pose.
    ///
    /// # Errors
    /// Those of `view`, and if a HEIF file is in the place of the image.
    pub(super) fn add(
        &mut self,
        image: PathBuf,
        view: impl FnOnce(PathBuf) -> Result<Option<UnreadView>>,
    ) -> Result<()> {
        match image.try_exists() {
            // A folder without permission is another matter than a missing image.
            Err(e) if e.kind() == std::io::ErrorKind::PermissionDenied => {
                return Err(InputError::new(image, "image", e, "a file that may be read"));
            }
            Ok(true) => match view(image.clone())? {
                Some(view) => self.found.push(view),
                None => self.unposed.push(image),
            },
            Ok(false) | Err(_) => {
                refuse_unconverted(&image)?;
                self.missing.push(image);
            }
        }
        Ok(())
    }
}
