//! The background of a scene file.

#![warn(clippy::cast_possible_truncation)]

use std::path::{Path, PathBuf};

use field::{Background, Precision, UniformBackground};
use field::{Sphere, Vector3};
use files::InputError;
use files::json::Object;
use glam::DVec3;
use sdf_nn::Passes;
use sdf_nn::background::{Extent, Volume};
use serde_json::Value;

/// The background of a scene file.
#[derive(Clone, Debug, PartialEq)]
pub enum BackgroundModel {
    /// One radiance along all rays.
    Constant {
        /// Linear RGB.
        radiance: [f64; 3],
        /// The JSON pointer of the array of numbers.
        pointer: &'static str,
    },
    /// An environment by direction, or a volume behind a sphere.
    Volume {
        /// The background file.
        path: PathBuf,
        /// Its bytes.
        bytes: Vec<u8>,
        /// The sphere of the scene file, world units; `None` for an environment.
        sphere: Option<Sphere<f64>>,
    },
}

const TYPES: &str = "constant, direction or volume";

impl BackgroundModel {
    /// Reads the entry `background`: a colour, or an object with a type. Relative paths of
    /// background files start at `folder`.
    pub(crate) fn read(root: &Object<'_>, folder: &Path) -> Result<Self, InputError> {
        if !root.optional("background").is_some_and(Value::is_object) {
            let radiance = root.light("background")?;
            return Ok(BackgroundModel::Constant { radiance, pointer: "/background" });
        }
        let object = root.object("background")?;
        let model = match object.string("type")? {
            "constant" => BackgroundModel::Constant {
                radiance: object.light("radiance")?,
                pointer: "/background/radiance",
            },
            "direction" => Self::read_volume(&object, folder, None)?,
            "volume" => {
                let center = DVec3::from(object.numbers("center")?);
                let sphere = Sphere { center, radius: object.positive("radius")? };
                Self::read_volume(&object, folder, Some(sphere))?
            }
            _ => return Err(object.error("type", TYPES)),
        };
        object.finish()?;
        Ok(model)
    }

    /// Reads the background file that an object names, and checks that its extent is that of the
    /// object's type.
    fn read_volume(
        object: &Object<'_>,
        folder: &Path,
        sphere: Option<Sphere<f64>>,
    ) -> Result<Self, InputError> {
        let path = folder.join(object.string("weights")?);
        let bytes = files::read(&path, "weights", "a background file")?;
        let extent = volume::<f64>(&path, &bytes)?.extent();
        let expected = if sphere.is_some() { Extent::Volume } else { Extent::Direction };
        if extent != expected {
            let (found, expected) = (format!("{extent}"), format!("{expected}"));
            return Err(InputError::new(path, "dsdf.background", found, expected));
        }
        Ok(BackgroundModel::Volume { path, bytes, sphere })
    }

    /// Builds the background in single or double precision, for points relative to `origin`.
    pub(crate) fn build<R: Precision + Passes>(
        &self,
        origin: DVec3,
    ) -> Result<Box<dyn Background<R>>, InputError> {
        Ok(match self {
            BackgroundModel::Constant { radiance, .. } => {
                Box::new(UniformBackground(R::Vec3::of(DVec3::from(*radiance))))
            }
            BackgroundModel::Volume { path, bytes, sphere } => {
                let own = volume::<R>(path, bytes)?;
                let own = if let Some(sphere) = sphere { own.around(*sphere) } else { own };
                Box::new(own.about(origin))
            }
        })
    }

    /// The JSON pointer of every parameter that has one, in the order of the background's
    /// parameters. The weights of a file have none.
    pub fn pointers(&self) -> Vec<String> {
        match self {
            BackgroundModel::Constant { pointer, .. } => {
                (0..3).map(|channel| format!("{pointer}/{channel}")).collect()
            }
            BackgroundModel::Volume { .. } => Vec::new(),
        }
    }
}

/// Builds a volume from the bytes of a background file; `path` is for error messages.
fn volume<R: Precision + Passes>(path: &Path, bytes: &[u8]) -> Result<Volume<R>, InputError> {
    Volume::from_safetensors(bytes)
        .map_err(|e| InputError::new(path, "weights", e, "a background file"))
}
