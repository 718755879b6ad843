//! The background of a model: the radiance along rays that miss its solid.

use field::{Background, UniformBackground};
use files::{InputError, atomic_write};
use glam::{DVec3, Vec3};
use inspect::Picture;
use loss::photometry::BackgroundKind;
use random::{Name, Stream};
use sdf_nn::background::{Extent, INITIAL_VOLUME, Quadrature, Volume};

use crate::error::FitError;
use crate::picture_file;
use crate::run_file::RunFile;
use crate::run_folder::RunFolder;

const BACKGROUND_POINTS: Name = Name::new("places of the points on a background's rays", 27);

/// The background of a model.
#[derive(Clone, Debug)]
pub enum ModelBackground {
    /// One colour, which is not trained. Views whose photographs have colours of their own are
    /// rendered in front of these: see [`RunFile::background_of`].
    Constant(UniformBackground<f32>),
    /// A picture that stands still in the image, which is not trained.
    Picture(Picture),
    /// A volume with trained parameters.
    Trained(Volume<f32>),
}

/// The part of space that a trained background of this kind shows; `None` if it is not trained.
fn extent_of(kind: BackgroundKind) -> Option<Extent> {
    match kind {
        BackgroundKind::Constant | BackgroundKind::PerView | BackgroundKind::Picture => None,
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
            ModelBackground::Picture(picture) => picture,
            ModelBackground::Trained(volume) => volume,
        }
    }

    /// The background with random positions of the points on its rays, if it is trained; see
    /// [`Volume::jittered`].
    pub(crate) fn jittered(&self, stream: Stream) -> Option<Quadrature<'_, f32>> {
        match self {
            ModelBackground::Constant(_) | ModelBackground::Picture(_) => None,
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
            ModelBackground::Constant(_) | ModelBackground::Picture(_) => &[],
            ModelBackground::Trained(volume) => volume.parameters(),
        }
    }

    /// Sets the trained parameters.
    pub(crate) fn set_parameters(&mut self, parameters: &[f32]) {
        match self {
            ModelBackground::Constant(_) | ModelBackground::Picture(_) => {
                assert!(parameters.is_empty(), "{} parameters, expected none", parameters.len());
            }
            ModelBackground::Trained(volume) => volume.set_parameters(parameters),
        }
    }

    /// The picture, if it is one.
    pub(crate) fn picture(&self) -> Option<&Picture> {
        match self {
            ModelBackground::Picture(picture) => Some(picture),
            ModelBackground::Constant(_) | ModelBackground::Trained(_) => None,
        }
    }

    /// Writes `background.safetensors` into a run folder unless it is a constant: a volume in world
    /// units, or a picture. The model is relative to `origin`.
    pub(crate) fn save(&self, run: &RunFolder, origin: DVec3) -> Result<(), FitError> {
        let path = run.background();
        match self {
            ModelBackground::Constant(_) => Ok(()),
            ModelBackground::Picture(picture) => Ok(picture_file::save(picture, &path)?),
            ModelBackground::Trained(volume) => {
                let file = volume.file_about(-origin)?;
                Ok(atomic_write(&path, |out| file.write(out))?)
            }
        }
    }

    /// Reads the background of a run folder, for points relative to the run's origin.
    pub(crate) fn load(run: &RunFolder, file: &RunFile) -> Result<Self, InputError> {
        let path = run.background();
        let read = || files::read(&path, "background", "the background of a run");
        let expected = match (extent_of(file.background_kind), file.background_kind) {
            (Some(expected), _) => expected,
            (None, BackgroundKind::Picture) => {
                return Ok(ModelBackground::Picture(picture_file::parse(&read()?, &path)?));
            }
            (None, _) => return Ok(Self::constant(file)),
        };
        let bytes = read()?;
        let volume = Volume::from_safetensors(&bytes)
            .map_err(|e| InputError::new(&path, "background", e, "a background file"))?;
        if volume.extent() != expected {
            let expected = format!("{expected}, as in fit.toml");
            return Err(InputError::new(&path, "background", volume.extent(), expected));
        }
        Ok(ModelBackground::Trained(volume.about(file.origin())))
    }
}
