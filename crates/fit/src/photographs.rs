//! The photographs of a fit: their pyramid, and all that a fit learns about them.

use std::path::Path;

use dataset::{Dataset, View};
use field::{BackgroundPerCamera, Sphere};
use files::{InputError, check_memory};
use glam::{DVec3, Vec3};
use inspect::Picture;
use loss::photometry::{
    BackgroundKind, ExposureModel, Gains, Level, MEMORY_PER_PIXEL, Photograph, pyramid,
};
use multiview::calibrate::{Calibration, CameraDecision, Freedom};
use multiview::stereo::{Consistency, Guide, View as StereoView};
use render::Camera;

use crate::camera_corrections::Corrections;
use crate::cameras::{calibration, freedom_by_matches};
use crate::checkpoint::Optimised;
use crate::depths::Depths;
use crate::exposures::RunExposures;
use crate::run_cameras::RunCameras;
use crate::run_file::RunFile;

/// The largest number of levels of the pyramid: the coarsest has 1/8 of the size.
const LEVELS: usize = 4;

/// The most pixels along a side of a photograph: a [`Draw`](loss::photometry::Draw) has coordinates
/// of 16 bits.
const MOST_SIDE: u32 = 65535;

/// The photographs of a fit.
#[derive(Debug)]
pub struct Photographs {
    /// The photographs with their cameras, as they were read.
    pub dataset: Dataset,
    /// The pyramid, the finest level first.
    pub(crate) levels: Vec<Level>,
    /// The background of each view, if the photographs have colours of their own.
    pub(crate) colors: Option<BackgroundPerCamera<f32>>,
    /// The picture behind the object, if it stands still in the photographs.
    pub(crate) picture: Option<Picture>,
    /// The exposures of the photographs, if they are fitted.
    pub(crate) gains: Option<Gains>,
    /// The corrections of the cameras.
    pub(crate) corrections: Corrections<Calibration>,
    /// The decision about the cameras that was made before the next iteration.
    pub(crate) decision: Option<CameraDecision>,
    /// The photographs whose patches are compared, once the surface is sharp.
    pub(crate) consistency: Option<Consistency>,
    /// The depths of the training views, once they were looked for.
    pub(crate) depths: Option<Depths>,
}

/// Refuses a photograph with a side that is too long.
fn check_sides(views: &[View]) -> Result<(), InputError> {
    let is_long = |view: &&View| view.image.width.max(view.image.height) > MOST_SIDE;
    let Some(view) = views.iter().find(is_long) else { return Ok(()) };
    let found = format!("{} x {} pixels", view.image.width, view.image.height);
    let expected = format!("sides of at most {MOST_SIDE} pixels; --downscale N reduces them");
    Err(InputError::new(&view.path, "size", found, expected))
}

/// Photographs with their cameras, as `multiview` takes them.
pub(crate) fn stereo_views<'a>(
    cameras: &'a [Camera],
    photographs: &'a [Photograph],
) -> Vec<StereoView<'a>> {
    let view = |(camera, photograph): (&'a Camera, &'a Photograph)| StereoView {
        camera,
        image: &photograph.image,
    };
    cameras.iter().zip(photographs).map(view).collect()
}

/// The picture behind the object, if the run models one.
fn picture_of(dataset: &Dataset, file: &RunFile) -> Result<Option<Picture>, InputError> {
    if file.background_kind != BackgroundKind::Picture {
        return Ok(None);
    }
    let picture = Picture::of(&dataset.train, &file.sphere());
    let wrong = || {
        let found = "picture, and photographs of several sizes";
        let expected = "photographs of one size, from a fixed camera";
        InputError::new(&file.dataset, "background", found, expected)
    };
    picture.map(Some).ok_or_else(wrong)
}

impl Photographs {
    /// The photographs of a run, before anything is fitted.
    ///
    /// # Errors
    /// If they need more memory than there is, a side has more than 65,535 pixels, or no ray of a
    /// pixel meets the bounding sphere.
    pub(crate) fn new(dataset: Dataset, file: &RunFile) -> Result<Self, InputError> {
        let pixels: u64 = dataset.train.iter().map(|v| v.image.pixels.len() as u64).sum();
        let found = format!("{pixels} pixels of photographs");
        check_memory(&file.dataset, "images", found, pixels * MEMORY_PER_PIXEL)?;
        check_sides(&dataset.train)?;

        let background = file.background_model(&dataset.train, picture_of(&dataset, file)?);
        let levels = pyramid(&dataset.train, file.masks, &background, LEVELS);
        if levels[0].pixel_count() == 0 {
            let found = "no pixel whose ray meets the sphere";
            let expected = "a sphere that the cameras see (option --bounds)";
            return Err(InputError::new(&file.dataset, "bounds", found, expected));
        }

        let is_per_view = file.exposure_model == ExposureModel::PerView;
        Ok(Photographs {
            levels,
            colors: file.colors(&background.estimates),
            picture: background.picture,
            gains: is_per_view.then(|| Gains::new(dataset.train.len())),
            corrections: Corrections::Undecided,
            decision: None,
            consistency: None,
            depths: None,
            dataset,
        })
    }

    /// The gain of each photograph, if they are fitted; else empty.
    pub(crate) fn factors(&self) -> Vec<Vec3> {
        self.gains.as_ref().map(Gains::factors).unwrap_or_default()
    }

    /// The depths that guide an iteration on a level of the pyramid.
    pub(crate) fn guide(&self, level: usize) -> Option<Guide<'_>> {
        self.depths.as_ref()?.guide(level)
    }

    /// Makes ready the comparison of patches of an object in `ball`, at full size.
    pub(crate) fn prepare_consistency(&mut self, ball: &Sphere<f64>) {
        if self.consistency.is_none() {
            let Level { cameras, photographs, .. } = &self.levels[0];
            self.consistency = Some(Consistency::new(&stereo_views(cameras, photographs), ball));
        }
    }

    /// The exposures as they are fitted so far; `None` if they are equal.
    pub fn exposures(&self) -> Option<RunExposures> {
        self.gains.as_ref().map(|gains| RunExposures::new(&self.dataset.train, gains))
    }

    /// The cameras as they are refined so far; `None` if they are those of the data set. The
    /// photographs are relative to `origin`.
    pub fn cameras(&self, origin: DVec3) -> Option<RunCameras> {
        let of = |c: &Calibration| RunCameras::new(&self.dataset.train, c, origin);
        self.corrections.get().map(of)
    }

    /// The share of the pixels with a known depth, if depths were looked for; 0 if too little is
    /// known to use it.
    pub fn known_depths(&self) -> Option<f64> {
        self.depths.as_ref().map(Depths::known)
    }

    /// Restores the exposures of a checkpoint.
    pub(crate) fn restore_exposures(
        &mut self,
        state: Option<&Optimised>,
        checkpoint: &Path,
    ) -> Result<(), InputError> {
        let wrong = |found: &dyn std::fmt::Display, expected: &str| {
            InputError::new(checkpoint, "exposures", found, expected)
        };
        match (&mut self.gains, state) {
            (None, None) => Ok(()),
            (Some(gains), Some(state)) => {
                let [logarithms, first, second] = state.parts();
                let restored = gains.restore(logarithms, first, second, state.steps);
                restored.map_err(|e| wrong(&e, "the exposures of this run's photographs"))
            }
            (Some(_), None) => Err(wrong(&"nothing", "exposures, as in fit.toml")),
            (None, Some(_)) => Err(wrong(&"exposures", "none, as in fit.toml")),
        }
    }

    /// Restores the corrections of the cameras of a checkpoint.
    pub(crate) fn restore_corrections(
        &mut self,
        state: &Corrections<Optimised>,
        file: &RunFile,
        checkpoint: &Path,
    ) -> Result<(), InputError> {
        let choice = file.options.refine_cameras;
        let restored = |freedom, state| self.calibration(freedom, state, file, checkpoint);
        self.corrections = match state {
            Corrections::Undecided => Corrections::Undecided,
            Corrections::Given => Corrections::Given,
            Corrections::Refined(state) => Corrections::Refined(restored(choice.freedom(), state)?),
            Corrections::Adjusted(state) => {
                Corrections::Adjusted(restored(freedom_by_matches(choice), state)?)
            }
        };
        Ok(())
    }

    /// The calibration of a checkpoint, with these free parameters.
    fn calibration(
        &self,
        freedom: Option<Freedom>,
        state: &Optimised,
        file: &RunFile,
        checkpoint: &Path,
    ) -> Result<Calibration, InputError> {
        let wrong = |found: &dyn std::fmt::Display, expected: &str| {
            InputError::new(checkpoint, "cameras", found, expected)
        };
        let Some(freedom) = freedom else {
            return Err(wrong(&"refined", "given, by refine_cameras of fit.toml"));
        };
        let mut calibration = calibration(&self.dataset.train, file.sphere(), freedom);
        let [parameters, first, second] = state.parts();
        calibration
            .restore(parameters, first, second, state.steps)
            .map_err(|e| wrong(&e, "the refinement of this run's cameras"))?;
        Ok(calibration)
    }
}
