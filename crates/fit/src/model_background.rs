//! The background of a model: the radiance along rays that miss its solid.

use std::path::Path;

use background::{Extent, Volume};
use glam::{DVec3, Vec3};
use io::{InputError, atomic_write};
use random::{Purpose, Stream};
use render::{Background, UniformBackground};
use serde::{Deserialize, Serialize};

use crate::run_file::RunFile;

/// The choice of a model for the background.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum BackgroundChoice {
    /// A constant where the photographs have a uniform background, and else a volume
    #[default]
    Auto,
    /// One colour, estimated from the photographs
    Constant,
    /// An environment by direction: right where everything behind the object is far away
    Direction,
    /// Everything behind the bounding sphere, near and far
    Volume,
}

/// The model for the background.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BackgroundKind {
    /// One colour, which is not trained.
    Constant,
    /// An environment by direction.
    Direction,
    /// Everything behind the bounding sphere.
    Volume,
}

/// The least confidence in a uniform background with which `auto` takes a constant.
const LEAST_CONFIDENCE: f32 = 0.5;

impl BackgroundChoice {
    /// The model, for photographs with this confidence (0 to 1) in a uniform background.
    pub fn resolve(self, confidence: f32) -> BackgroundKind {
        match self {
            BackgroundChoice::Auto if confidence < LEAST_CONFIDENCE => BackgroundKind::Volume,
            BackgroundChoice::Auto | BackgroundChoice::Constant => BackgroundKind::Constant,
            BackgroundChoice::Direction => BackgroundKind::Direction,
            BackgroundChoice::Volume => BackgroundKind::Volume,
        }
    }
}

/// The background of a model.
#[derive(Clone, Debug)]
pub enum ModelBackground {
    /// One colour, which is not trained.
    Constant(UniformBackground<f32>),
    /// A volume with trained parameters.
    Trained(Volume<f32>),
}

/// The file of a trained background in a run folder.
const FILE: &str = "background.safetensors";

impl ModelBackground {
    /// The background at the start of a fit.
    pub(crate) fn initial(file: &RunFile) -> Self {
        let extent = match file.background_kind {
            BackgroundKind::Constant => return Self::constant(file),
            BackgroundKind::Direction => Extent::Direction,
            BackgroundKind::Volume => Extent::Volume,
        };
        let seed = Stream::new(file.options.seed, Purpose::InitialBackground).bits();
        ModelBackground::Trained(Volume::new(extent, file.sphere(), seed))
    }

    fn constant(file: &RunFile) -> Self {
        ModelBackground::Constant(UniformBackground(Vec3::from(file.background)))
    }

    /// The background as the argument of a scene.
    pub fn as_background(&self) -> &dyn Background<f32> {
        match self {
            ModelBackground::Constant(uniform) => uniform,
            ModelBackground::Trained(volume) => volume,
        }
    }

    /// The number of trained parameters of a background of this kind.
    pub(crate) fn parameter_count(kind: BackgroundKind) -> usize {
        match kind {
            BackgroundKind::Constant => 0,
            BackgroundKind::Direction | BackgroundKind::Volume => Volume::<f32>::PARAMETERS,
        }
    }

    /// The trained parameters.
    pub(crate) fn parameters(&self) -> &[f32] {
        match self {
            ModelBackground::Constant(_) => &[],
            ModelBackground::Trained(volume) => volume.parameters(),
        }
    }

    /// Sets the trained parameters.
    pub(crate) fn set_parameters(&mut self, parameters: &[f32]) {
        if let ModelBackground::Trained(volume) = self {
            volume.set_parameters(parameters);
        }
    }

    /// Writes `background.safetensors` into a run folder if it is trained, in world units. The
    /// model is relative to `origin`.
    pub(crate) fn save(&self, run: &Path, origin: DVec3) -> anyhow::Result<()> {
        let ModelBackground::Trained(volume) = self else { return Ok(()) };
        let bytes = volume.clone().about(-origin).to_safetensors()?;
        atomic_write(&run.join(FILE), |out| Ok(out.write_all(&bytes)?))
    }

    /// Reads the background of a run folder, for points relative to the run's origin.
    pub(crate) fn load(run: &Path, file: &RunFile) -> Result<Self, InputError> {
        if file.background_kind == BackgroundKind::Constant {
            return Ok(Self::constant(file));
        }
        let path = run.join(FILE);
        let bytes = io::read(&path, "background", "the background of a run")?;
        let volume = Volume::from_safetensors(&bytes)
            .map_err(|e| InputError::new(&path, "background", e, "a background file"))?;
        Ok(ModelBackground::Trained(volume.about(file.origin())))
    }
}
