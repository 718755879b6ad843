//! The file `fit.toml` of a run folder.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use dataset::{Dataset, LoadOptions, Unread, View};
use field::Sphere;
use field::{BackgroundPerCamera, Check};
use files::{ARGUMENTS, InputError, SPHERE, atomic_write, is_sphere};
use glam::{DVec3, Vec3};
use inspect::exposures_differ;
use inspect::{
    BackgroundEstimate, Picture, SphereSource, Surroundings, check_places, surroundings,
};
use serde::{Deserialize, Serialize};

use crate::error::FitError;
use crate::options::{FitOptions, refuse_invalid};
use crate::run_folder::RunFolder;
use crate::split::Split;
use loss::photometry::{
    BackgroundChoice, BackgroundKind, BackgroundModel, ExposureModel, MaskUse, put_over_black,
};

/// The content of `fit.toml`: the input of a run. Resuming and evaluating a run read it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFile {
    /// The folder of the data set.
    pub dataset: PathBuf,
    /// The centre x, y, z and the radius of the bounding sphere, in the units of the data set.
    pub bounds: [f64; 4],
    /// The use of the masks.
    pub masks: MaskUse,
    /// The model for the background.
    pub background_kind: BackgroundKind,
    /// The radiance of a uniform background, estimated from the photographs, linear RGB.
    pub background: [f32; 3],
    /// A robust standard deviation of the background, in display units.
    pub background_spread: f32,
    /// The confidence that the photographs have a uniform background, 0 to 1.
    pub background_confidence: f32,
    /// The model for the exposures of the photographs.
    pub exposure_model: ExposureModel,
    /// How many times the bounding sphere may still grow, if its surface ends on it. A fit whose
    /// sphere is sure has none: it was asked for, or points or outlines show the object.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub sphere_growths: u32,
    /// The views. A run of an earlier version has none: its views are those of the data set as it
    /// is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub views: Option<Split>,
    /// The options.
    pub options: FitOptions,
}

/// How many times the bounding sphere of a new run may grow, if nothing but the cameras and matches
/// between photographs tells where the object ends.
const MOST_GROWTHS: u32 = 2;

fn is_zero(number: &u32) -> bool {
    *number == 0
}

/// The spread of the exposures, in stops, from which on each photograph has one of its own, where a
/// picture behind the object tells them.
const LEAST_STOPS: f64 = 0.02;

impl RunFile {
    /// The input of a new run on the data set at `path`: its bounding sphere, the use of its masks
    /// and the model for its background; and what its photographs show around the object.
    ///
    /// The options are not checked here; see [`FitOptions::validate`].
    ///
    /// # Errors
    /// By [`crate::MaskChoice::resolve`], or if the sphere is too small or too large for single
    /// precision: its units are, or it comes from cameras that all stand at one place.
    pub fn of_dataset(
        path: PathBuf,
        dataset: &Dataset,
        options: &FitOptions,
    ) -> Result<(Self, Surroundings), InputError> {
        let options = &options.clone().with_schedule();
        let mut found = surroundings(dataset, options.bounds(), false);
        let arguments = Path::new(ARGUMENTS);
        // A background that the user models is there.
        let is_modelled = options.background != BackgroundChoice::Auto;
        let masks = options.masks.resolve(dataset, found.is_uniform() || is_modelled, arguments)?;
        let mut background_kind = options.background.resolve(&found);
        if masks == MaskUse::Coverage {
            found = surroundings(dataset, options.bounds(), true);
            found.background = BackgroundEstimate::NOTHING;
            background_kind = BackgroundKind::Constant;
        } else if found.source == SphereSource::Cameras {
            found = found.with_matches(dataset);
            background_kind = options.background.resolve(&found);
        }
        let Sphere { center, radius } = found.sphere;
        let bounds = [center.x, center.y, center.z, radius];
        if !is_sphere(bounds) {
            check_places(dataset)?;
            let found = format!("{bounds:?}, {}", found.source);
            return Err(InputError::new(&dataset.path, "bounding sphere", found, SPHERE));
        }
        let BackgroundEstimate { color, spread, confidence } = found.background;
        let is_trained = background_kind.is_trained();
        let mut file = RunFile {
            dataset: path,
            bounds,
            masks,
            background_kind,
            background: color,
            background_spread: spread,
            background_confidence: match background_kind {
                BackgroundKind::PerView => found.confidence_of_views(),
                _ => confidence,
            },
            exposure_model: ExposureModel::Even,
            views: Some(Split::of(dataset, radius)),
            sphere_growths: match found.source {
                SphereSource::Cameras | SphereSource::Matches if is_trained => MOST_GROWTHS,
                _ => 0,
            },
            options: FitOptions {
                soft: Some(options.soft_for(is_trained)),
                learning_rate: Some(options.learning_rate_for(is_trained)),
                ..options.clone()
            },
        };
        let differ = match background_kind {
            BackgroundKind::Picture => found.still.stops() > LEAST_STOPS,
            _ => {
                // As the fit sees them: without the background that masks remove.
                let seen = file.composited(Cow::Borrowed(dataset));
                exposures_differ(&seen.train, &found.sphere, &file.background())
            }
        };
        file.exposure_model = options.exposure.resolve(differ);
        Ok((file, found))
    }

    /// The same run in another bounding sphere, which grows once less. `dataset` is as it was read.
    #[must_use]
    pub fn grown(&self, sphere: &Sphere<f64>, dataset: &Dataset) -> Self {
        let Sphere { center, radius } = *sphere;
        RunFile {
            bounds: [center.x, center.y, center.z, radius],
            views: Some(Split::of(dataset, radius)),
            sphere_growths: self.sphere_growths.saturating_sub(1),
            ..self.clone()
        }
    }

    /// The point that a run's cameras, model and mesh are relative to, in the units of the data
    /// set: see [`Sphere::precise_origin`].
    pub fn origin(&self) -> DVec3 {
        self.world_sphere().precise_origin()
    }

    /// The bounding sphere, relative to [`origin`](Self::origin).
    pub fn sphere(&self) -> Sphere<f64> {
        let sphere = self.world_sphere();
        Sphere { center: sphere.center - self.origin(), ..sphere }
    }

    /// The bounding sphere, in the units of the data set.
    pub fn world_sphere(&self) -> Sphere<f64> {
        let [x, y, z, radius] = self.bounds;
        Sphere { center: DVec3::new(x, y, z), radius }
    }

    /// The confidence in a uniform background: 0 for a run that trains another one.
    pub(crate) fn uniform_confidence(&self) -> f64 {
        let is_trained = self.background_kind.is_trained();
        if is_trained { 0.0 } else { f64::from(self.background_confidence) }
    }

    /// The photographs of the run are read at 1/`downscale` of their width and height.
    ///
    /// It is 1 if the options have no number; those of a file that was loaded have one.
    pub fn downscale(&self) -> u32 {
        self.options.downscale.unwrap_or(1)
    }

    /// Opens the data set of the run, with its views to fit and to hold out; or another data set,
    /// of which no view to fit of the run is held out.
    ///
    /// # Errors
    /// If it cannot be read, or if the run's own data set lacks a view of the run or has another
    /// pose for it.
    pub fn open(&self, other: Option<&Path>) -> Result<Unread, InputError> {
        let path = other.unwrap_or(&self.dataset);
        if !path.exists() {
            let expected = match other {
                Some(_) => "a data set",
                None => {
                    "a data set; after a move, `dsdf fit FOLDER -o RUN --resume` tells the run its \
                     new place"
                }
            };
            let found = "no such file or folder";
            return Err(InputError::new(path, "data set", found, expected));
        }
        let unread = dataset::open(path)?;
        match (&self.views, other) {
            (None, _) => Ok(unread),
            (Some(split), None) => split.choose(unread, self.bounds[3]),
            (Some(Split { train, held_out, .. }), Some(_)) => {
                Ok(unread.split_like([train, held_out]))
            }
        }
    }

    /// Reads the photographs of [`open`](Self::open) at the run's size.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn read(&self, other: Option<&Path>) -> Result<Dataset, InputError> {
        self.open(other)?.read(&LoadOptions { downscale: self.downscale() }, &mut |_| {})
    }

    /// The data set as the run sees it: relative to [`origin`](Self::origin), and over black if
    /// the run uses the coverage of the object.
    #[must_use]
    pub fn prepare(&self, dataset: Dataset) -> Dataset {
        let dataset = self.composited(Cow::Owned(dataset)).into_owned().about(self.origin());
        if self.masks == MaskUse::LeaveOut { dataset } else { dataset.with_all_pixels() }
    }

    /// The data set over black, if the run uses the coverage of the object.
    #[must_use]
    pub fn composited<'a>(&self, mut dataset: Cow<'a, Dataset>) -> Cow<'a, Dataset> {
        if self.masks == MaskUse::Coverage {
            let dataset = dataset.to_mut();
            put_over_black(&mut dataset.train);
            // A photograph with its background would be compared with one without.
            let all = dataset.test.len();
            dataset.test.retain(|view| view.coverage().is_some());
            let left_out = all - dataset.test.len();
            if left_out > 0 {
                let text = "held-out views have no mask of the object, and are left out";
                dataset.notes.push(format!("{left_out} of {all} {text}"));
            }
            put_over_black(&mut dataset.test);
        }
        dataset
    }

    /// The estimated uniform background: one of all views, or one of each.
    fn estimates<'a>(&self, views: impl IntoIterator<Item = &'a View>) -> Vec<BackgroundEstimate> {
        if self.background_kind == BackgroundKind::PerView {
            let sphere = self.sphere();
            let of_view = |view| BackgroundEstimate::of_view(view, &sphere);
            return views.into_iter().map(of_view).collect();
        }
        let confidence = self.uniform_confidence() as f32;
        vec![BackgroundEstimate { confidence, ..self.background() }]
    }

    /// The estimated uniform background of all views.
    pub fn background(&self) -> BackgroundEstimate {
        BackgroundEstimate {
            color: self.background,
            spread: self.background_spread,
            confidence: self.background_confidence,
        }
    }

    /// The background of each of these views, if the photographs have colours of their own.
    pub fn background_of<'a>(
        &self,
        views: impl IntoIterator<Item = &'a View>,
    ) -> Option<BackgroundPerCamera<f32>> {
        self.colors(&self.estimates(views))
    }

    /// The colours of the estimates, if each is that of one view.
    pub(crate) fn colors(
        &self,
        estimates: &[BackgroundEstimate],
    ) -> Option<BackgroundPerCamera<f32>> {
        let colors = || estimates.iter().map(|b| Vec3::from(b.color)).collect();
        (self.background_kind == BackgroundKind::PerView).then(|| BackgroundPerCamera(colors()))
    }

    /// The model that tells background pixels of these views from pixels of the object. `picture`
    /// is the one behind them, if the run has one.
    pub(crate) fn background_model(
        &self,
        views: &[View],
        picture: Option<Picture>,
    ) -> BackgroundModel {
        BackgroundModel {
            bounds: self.sphere(),
            estimates: self.estimates(views),
            picture,
            is_trained: self.background_kind.is_trained(),
        }
    }

    /// Reads the `fit.toml` of a run folder.
    ///
    /// The options are not checked here; see [`FitOptions::validate`].
    ///
    /// # Errors
    /// If the file is missing, has a wrong entry or lacks one, or if a number of the bounding
    /// sphere or of the background is out of range.
    pub fn load(run: &Path) -> Result<Self, InputError> {
        let path = RunFolder::new(run).fit_toml();
        let text = files::read_text(&path, "run", "the folder of a fit")?;
        let file: RunFile = toml::from_str(&text).map_err(|e| {
            InputError::new(&path, key_of(&text, &e), e.message(), "the entries of a fit.toml")
        })?;
        file.refuse_differences(&path, &text)?;
        file.refuse_out_of_range(&path)?;
        Ok(file)
    }

    /// Refuses a file without one of the entries that [`RunFile::save`] writes, since a default in
    /// its place would change the run, and a list with too many numbers.
    fn refuse_differences(&self, path: &Path, text: &str) -> Result<(), InputError> {
        let (Ok(complete), Ok(given)) = (toml::Table::try_from(self), text.parse()) else {
            return Ok(());
        };
        match difference(&complete, &given) {
            Some((key, found, expected)) => Err(InputError::new(path, key, found, expected)),
            None => Ok(()),
        }
    }

    fn refuse_out_of_range(&self, path: &Path) -> Result<(), InputError> {
        let (color, spread) = (self.background, self.background_spread);
        let confidence = self.background_confidence;
        let FitOptions { iterations, time, downscale, .. } = self.options;
        let budget = format!("{iterations:?} iterations and the time {time:?}");
        refuse_invalid(
            path,
            vec![
                Check::new(
                    "train",
                    "an empty list",
                    self.views.as_ref().is_none_or(|views| !views.train.is_empty()),
                    "the names of the views to fit",
                ),
                // Another number would read other pixels than the run did.
                Check::new("downscale", "nothing", downscale.is_some(), "an entry, for example 1"),
                Check::new("time", budget, iterations.is_none() || time.is_none(), "one of both"),
                Check::new("bounds", format!("{:?}", self.bounds), is_sphere(self.bounds), SPHERE),
                Check::new(
                    "background_kind",
                    format!("{:?} with masks = \"coverage\"", self.background_kind),
                    self.masks != MaskUse::Coverage
                        || self.background_kind == BackgroundKind::Constant,
                    "constant",
                ),
                Check::new(
                    "background",
                    format!("{color:?}"),
                    color.iter().all(|c| c.is_finite() && *c >= 0.0),
                    "three finite numbers, 0 or more",
                ),
                Check::new(
                    "background_spread",
                    spread,
                    spread.is_finite() && spread >= 0.0,
                    "a finite number, 0 or more",
                ),
                Check::new(
                    "background_confidence",
                    confidence,
                    (0.0..=1.0).contains(&confidence),
                    "0 to 1",
                ),
            ],
        )
    }

    /// Writes the `fit.toml` of a run folder.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self, run: &Path) -> Result<(), FitError> {
        let options = FitOptions { downscale: Some(self.downscale()), ..self.options.clone() };
        let text = toml::to_string(&RunFile { options, ..self.clone() })?;
        Ok(atomic_write(&RunFolder::new(run).fit_toml(), |out| out.write_all(text.as_bytes()))?)
    }
}

#[cfg(test)]
impl RunFile {
    /// A run in the unit sphere, in front of a black background.
    pub(crate) fn of_test(options: FitOptions) -> Self {
        RunFile {
            dataset: PathBuf::new(),
            bounds: [0.0, 0.0, 0.0, 1.0],
            masks: MaskUse::None,
            background_kind: BackgroundKind::Constant,
            background: [0.0; 3],
            background_spread: 0.01,
            background_confidence: 1.0,
            exposure_model: ExposureModel::Even,
            sphere_growths: 0,
            views: None,
            options,
        }
    }
}

/// The key that a TOML error is about; "line N" if there is none.
fn key_of(text: &str, error: &toml::de::Error) -> String {
    if let Some((_, rest)) = error.message().split_once("missing field `")
        && let Some((key, _)) = rest.split_once('`')
    {
        return key.to_owned();
    }
    let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
    let line = text.get(before.rfind('\n').map_or(0, |end| end + 1)..).unwrap_or_default();
    let key = line.lines().next().and_then(|line| line.split_once('='));
    let number = before.matches('\n').count() + 1;
    key.map_or(format!("line {number}"), |(key, _)| key.trim().to_owned())
}

/// The first entry of `complete` that `given` lacks, or of which `given` has a list of another
/// length, also in tables inside: its key, the finding, and the expectation.
fn difference(complete: &toml::Table, given: &toml::Table) -> Option<(String, String, String)> {
    use toml::Value::{Array, Table};
    complete.iter().find_map(|(key, value)| match (value, given.get(key)) {
        (Table(complete), Some(Table(given))) => difference(complete, given),
        (Array(complete), Some(Array(given))) if complete.len() != given.len() => {
            let found = format!("{} numbers", given.len());
            Some((key.clone(), found, format!("{} numbers", complete.len())))
        }
        (_, Some(_)) => None,
        (value, None) => {
            let expected = format!("an entry, by default {value}");
            Some((key.clone(), "nothing".to_owned(), expected))
        }
    })
}
