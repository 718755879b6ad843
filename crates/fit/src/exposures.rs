//! The exposures of photographs in a fit.

use std::path::Path;

use dataset::{Dataset, View};
use files::{InputError, WriteError};
use glam::Vec3;
use loss::photometry::{Gains, gain_between};
use render::{InvalidField, render};
use serde::{Deserialize, Serialize};

use crate::model::Model;
use crate::run_file::RunFile;
use crate::run_folder::RunFolder;
use crate::run_json;
use crate::solid::Solid;

/// The content of `exposures.json` in a run folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunExposures {
    /// The training views.
    pub views: Vec<RunExposure>,
}

/// The exposure of a view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunExposure {
    /// The name of the view.
    pub name: String,
    /// The exposure of red, green and blue, in stops: log₂ of the factor of the radiance. The mean
    /// over the views is 0.
    pub stops: [f64; 3],
}

/// The largest exposure of a file, in stops.
const MOST_STOPS: f64 = 10.0;

impl RunExposures {
    pub(crate) fn new(views: &[View], gains: &Gains) -> Self {
        let of = |(view, stops): (&View, [f64; 3])| RunExposure { name: view.name.clone(), stops };
        RunExposures { views: views.iter().zip(gains.stops()).map(of).collect() }
    }

    pub(crate) fn save(&self, run: &RunFolder) -> Result<(), WriteError> {
        run_json::save(&run.exposures(), self)
    }

    /// The exposures of a run; `None` if they are equal.
    ///
    /// # Errors
    /// If the file is there and cannot be read, or has a wrong entry.
    pub fn load(run: &Path) -> Result<Option<Self>, InputError> {
        let path = RunFolder::new(run).exposures();
        let found: Option<Self> = run_json::load(&path, "exposures")?;
        let Some(exposures) = found else { return Ok(None) };
        let is_wrong =
            |own: &&RunExposure| own.stops.iter().any(|s| s.is_nan() || s.abs() > MOST_STOPS);
        match exposures.views.iter().find(is_wrong) {
            Some(own) => {
                let found = format!("{:?} stops of {}", own.stops, own.name);
                Err(run_json::wrong(&path, "exposures", &found))
            }
            None => Ok(Some(exposures)),
        }
    }

    /// Whether it has an exposure of each training view of a data set.
    pub fn has_views_of(&self, dataset: &Dataset) -> bool {
        let has = |view: &View| self.views.iter().any(|own| own.name == view.name);
        dataset.train.iter().all(has)
    }

    /// Brings the training photographs of a data set to the mean exposure. `run` is the folder of
    /// the run, for the message of an error.
    ///
    /// # Errors
    /// If the file lacks a view.
    pub fn apply(&self, dataset: &mut Dataset, run: &Path) -> Result<(), InputError> {
        for view in &mut dataset.train {
            let own = self.views.iter().find(|own| own.name == view.name).ok_or_else(|| {
                let field = format!("exposures: {}", view.name);
                let path = RunFolder::new(run).exposures();
                InputError::new(path, field, "nothing", "the exposure of each view")
            })?;
            divide(view, Vec3::from(own.stops.map(|stops| stops.exp2() as f32)));
        }
        Ok(())
    }
}

/// Divides a photograph by the factors of its channels.
fn divide(view: &mut View, gain: Vec3) {
    view.image.pixels.iter_mut().for_each(|p| *p = (Vec3::from(*p) / gain).into());
}

/// Brings photographs to the exposure of a run's model: each is divided by the factors by which it
/// shows the model's image best.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub fn match_exposures(
    model: &Model,
    file: &RunFile,
    views: &mut [View],
    progress: &(dyn Fn(f64) + Sync),
) -> Result<(), InvalidField> {
    let (solid, count) = (Solid::new(model, file), views.len() as f64);
    for (number, view) in views.iter_mut().enumerate() {
        let cameras = [view.camera];
        // A background of the photograph's own has its exposure.
        let colors = file.background_of(std::slice::from_ref(view));
        let scene = solid.scene_in_front_of(colors.as_ref(), &cameras);
        let image = render(&scene, 0, 1, file.options.seed, &|_| {})?;
        let used = view.used();
        let shown = image
            .coverage
            .iter()
            .zip(used)
            .map(|(coverage, used)| used && (colors.is_none() || *coverage > 0.0));
        let gain = gain_between(&image.film, &view.image, shown);
        divide(view, gain);
        progress((number + 1) as f64 / count);
    }
    Ok(())
}
