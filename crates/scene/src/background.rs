//! The background of a scene file.

use glam::DVec3;
use io::InputError;
use io::json::Object;
use render::{Background, Precision, UniformBackground};
use serde_json::Value;

/// The background of a scene file.
#[derive(Clone, Debug, PartialEq)]
pub enum BackgroundModel {
    /// One radiance along all rays, linear RGB.
    Constant([f64; 3]),
}

impl BackgroundModel {
    /// Reads the entry `background`: a colour, or an object with a type.
    pub(crate) fn read(root: &Object<'_>) -> Result<Self, InputError> {
        if !root.optional("background").is_some_and(Value::is_object) {
            return Ok(BackgroundModel::Constant(root.light("background")?));
        }
        let object = root.object("background")?;
        let model = match object.string("type")? {
            "constant" => BackgroundModel::Constant(object.light("radiance")?),
            _ => return Err(object.error("type", "constant")),
        };
        object.finish()?;
        Ok(model)
    }

    /// Builds the background in single or double precision.
    pub(crate) fn build<R: Precision>(&self) -> Box<dyn Background<R>> {
        match self {
            BackgroundModel::Constant(rgb) => {
                Box::new(UniformBackground(<R::Vec3 as field::Vector3<R>>::of(DVec3::from(*rgb))))
            }
        }
    }
}
