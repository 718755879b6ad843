//! A fit in memory.

use std::path::Path;

use dataset::Dataset;
use estimate::{Estimator, Registry};
use field::Sphere;
use files::InputError;
use loss::photometry::Level;
use loss::schedule::{band_window, direction_weight};
use rayon::prelude::*;
use render::{Camera, InvalidField, Sample, Scene};

use crate::checkpoint::Survey;
use crate::clock::Clock;
use crate::lattice::FieldLattice;
use crate::model::{HEAD_BANDS, Model};
use crate::model_background::ModelBackground;
use crate::optimiser::Optimiser;
use crate::photographs::Photographs;
use crate::run_file::RunFile;
use crate::solid::SLOPE_POINTS;

/// Rays that a thread traces together.
pub(crate) const TRACED_CHUNK: usize = 1024;

/// A fit in memory: a model, the photographs, an optimiser and a clock.
///
/// [`step`](Fit::step) is one iteration. A [`Session`](crate::Session) runs them to the end of the
/// budget and writes the files of a run.
pub struct Fit {
    /// The content of `fit.toml`.
    pub file: RunFile,
    /// The model.
    pub model: Model,
    /// The photographs, with all that the fit learns about them.
    pub photographs: Photographs,
    /// The iterations and the time so far.
    pub clock: Clock,
    pub(crate) optimiser: Optimiser,
    /// The last survey of the surface.
    pub(crate) survey: Option<Survey>,
    /// The last lattice of the field.
    pub(crate) lattice: Option<FieldLattice>,
    pub(crate) estimator: Box<dyn Estimator<f32>>,
}

impl std::fmt::Debug for Fit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Fit { file, clock, .. } = self;
        f.debug_struct("Fit").field("file", file).field("clock", clock).finish_non_exhaustive()
    }
}

impl Fit {
    /// A fit before its first iteration. The estimator that the options name comes from `registry`;
    /// `source` is the origin of the options, for the message of an error.
    ///
    /// # Errors
    /// If an option is not valid, a side of a photograph has more than 65,535 pixels, or no ray of
    /// a pixel meets the bounding sphere.
    pub fn new(
        dataset: Dataset,
        file: RunFile,
        registry: &Registry,
        source: &Path,
    ) -> Result<Self, InputError> {
        file.options.validate(source, registry)?;
        Self::of_valid(dataset, file, registry, source)
    }

    /// The fit of a run whose options were validated; see [`new`](Self::new).
    pub(crate) fn of_valid(
        dataset: Dataset,
        file: RunFile,
        registry: &Registry,
        source: &Path,
    ) -> Result<Self, InputError> {
        let Some(entry) = registry.get(&file.options.estimator) else {
            let expected = format!("one of {}", registry.names());
            let found = &file.options.estimator;
            return Err(InputError::new(source, "estimator", found, expected));
        };
        let estimator = entry.estimator(&file.options.estimator_options());
        let mut model = Model::initial(&file);
        let photographs = Photographs::new(dataset, &file)?;
        if let Some(picture) = &photographs.picture {
            model.background = ModelBackground::Picture(picture.clone());
        }
        let mut fit = Fit {
            optimiser: Optimiser::new(&model),
            photographs,
            file,
            model,
            clock: Clock::default(),
            survey: None,
            lattice: None,
            estimator,
        };
        fit.set_windows();
        Ok(fit)
    }

    /// The spent fraction of the budget (time or iterations), from 0; it can exceed 1. The time of
    /// searches for depths shortens the schedule, and is no part of it.
    pub fn progress(&self) -> f64 {
        self.clock.progress(self.file.options.budget())
    }

    /// The bounding sphere in single precision: the ball of the lattice.
    pub(crate) fn ball(&self) -> Sphere<f32> {
        let bounds = self.file.sphere();
        Sphere { center: bounds.center.as_vec3(), radius: bounds.radius as f32 }
    }

    /// Sets the weights of the octaves of both encodings and of the view direction for the current
    /// progress. They are part of the saved function, so a resumed fit must have the same.
    pub(crate) fn set_windows(&mut self) {
        let (progress, options) = (self.progress(), &self.file.options);
        let window = |bands| band_window(progress, bands);
        self.model.field.set_band_weights(&window(options.bands));
        let direction = direction_weight(progress, options.soft());
        self.model.head.set_input_weights(&window(HEAD_BANDS), direction);
    }

    /// The scene that the fit renders: its model in front of its background, in its bounding
    /// sphere, without the cap of a [`Solid`](crate::Solid). Rays start with the slope that the
    /// field has now.
    pub(crate) fn scene<'a>(&'a self, cameras: &'a [Camera]) -> Scene<'a, f32> {
        let Fit { model, file, .. } = self;
        let background = model.background.as_background();
        Scene::new(&model.field, &model.head, cameras, &file.sphere(), background)
            .with_slope_of_field(SLOPE_POINTS)
    }

    /// Whether the ray through the centre of a pixel of a training view hits the surface.
    ///
    /// The pixels of the coarsest level are tried first, then those of the photographs.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity along a ray.
    pub fn has_visible_surface(&self) -> Result<bool, InvalidField> {
        let any_hit = |level: &Level| {
            let scene = self.scene(&level.cameras);
            let samples: Vec<Sample> = level.centers().collect();
            let hit = |samples: &[Sample]| match scene.primary(samples) {
                Ok(primary) => (!primary.hits.is_empty()).then_some(Ok(true)),
                Err(error) => Some(Err(error)),
            };
            samples.par_chunks(TRACED_CHUNK).find_map_first(hit).unwrap_or(Ok(false))
        };
        let levels = &self.photographs.levels;
        let coarsest = levels.len() - 1;
        Ok(any_hit(&levels[coarsest])? || (coarsest > 0 && any_hit(&levels[0])?))
    }
}
