//! The background of a model: the radiance along rays that miss its solid.

use field::{Background, UniformBackground};
use files::{InputError, atomic_write};
use glam::{DVec3, Vec3};
use loss::photometry::BackgroundKind;
use random::{Name, Stream};
use sdf_nn::background::{Extent, INITIAL_VOLUME, Quadrature, Volume};

use crate::error::FitError;
use crate::run_file::RunFile;
use crate::run_folder::RunFolder;

const BACKGROUND_POINTS: Name = Name::new("places of the points on a background's rays", 27);

/// The background of a model.
#[derive(Clone, Debug)]
pub enum ModelBackground {
    /// One colour, which is not trained. Views whose photographs have colours of their own are
    /// rendered in front of these: see [`RunFile::background_of`].
    Constant(UniformBackground<f32>),
    /// A volume with trained parameters.
    Trained(Volume<f32>),
}

/// The part of space that a trained background of this kind shows; `None` if it is not trained.
fn extent_of(kind: BackgroundKind) -> Option<Extent> {
    match kind {
        BackgroundKind::Constant | BackgroundKind::PerView => None,
        BackgroundKind::Direction => Some(Extent::Direction),
        BackgroundKind::Volume => Some(Extent::Volume),
    }
}

impl ModelBackground {
    /// The background at the start of a fit.
    pub(crate) fn initial(file: &RunFile) -> Self {
        let Some(extent) = extent_of(file.background_kind) else { return Self::constant(file) };
        let stream = Stream::of_seed(file.options.seed).named(INITIAL_VOLUME);
        ModelBackground::Trained(Volume::new(extent, file.sphere(), stream))
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

    /// The background with random positions of the points on its rays, if it is trained; see
    /// [`Volume::jittered`].
    pub(crate) fn jittered(&self, stream: Stream) -> Option<Quadrature<'_, f32>> {
        match self {
            ModelBackground::Constant(_) => None,
            ModelBackground::Trained(volume) => {
                Some(volume.jittered(stream.named(BACKGROUND_POINTS)))
            }
        }
    }

    /// The number of trained parameters of a background of this kind.
    pub(crate) fn parameter_count(kind: BackgroundKind) -> usize {
        if kind.is_trained() { Volume::<f32>::PARAMETERS } else { 0 }
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
        match self {
            ModelBackground::Constant(_) => {
                assert!(parameters.is_empty(), "{} parameters of a constant", parameters.len());
            }
            ModelBackground::Trained(volume) => volume.set_parameters(parameters),
        }
    }

    /// Writes `background.safetensors` into a run folder if it is trained, in world units. The
    /// model is relative to `origin`.
    pub(crate) fn save(&self, run: &RunFolder, origin: DVec3) -> Result<(), FitError> {
        let ModelBackground::Trained(volume) = self else { return Ok(()) };
        let file = volume.file_about(-origin)?;
        Ok(atomic_write(&run.background(), |out| file.write(out))?)
    }

    /// Reads the background of a run folder, for points relative to the run's origin.
    pub(crate) fn load(run: &RunFolder, file: &RunFile) -> Result<Self, InputError> {
        let Some(expected) = extent_of(file.background_kind) else {
            return Ok(Self::constant(file));
        };
        let path = run.background();
        let bytes = files::read(&path, "background", "the background of a run")?;
        let volume = Volume::from_safetensors(&bytes)
            .map_err(|e| InputError::new(&path, "background", e, "a background file"))?;
        if volume.extent() != expected {
            let expected = format!("{expected}, as in fit.toml");
            return Err(InputError::new(&path, "background", volume.extent(), expected));
        }
        Ok(ModelBackground::Trained(volume.about(file.origin())))
    }
}
