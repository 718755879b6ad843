//! The parts of a scene in single and in double precision, compiled once.

use field::{Background, Precision, Shader};
use field::{Clipped, Field};
use sdf_nn::Passes;

use crate::{Result, SceneFile, in_precision};

/// A precision that the parts of a scene are built in: `f32` or `f64`.
///
/// Its functions are compiled in this crate. Generic functions would be compiled again, with every
/// shape and shader, in each crate that builds a scene.
pub trait ScenePrecision: Precision + Passes {
    /// [`SceneFile::field`].
    ///
    /// # Errors
    /// If a model file cannot be used.
    fn field_of(file: &SceneFile) -> Result<Box<dyn Field<Self>>>;

    /// [`SceneFile::shader`].
    ///
    /// # Errors
    /// If a model file cannot be used.
    fn shader_of<'a>(
        file: &SceneFile,
        occluders: &'a dyn Field<Self>,
    ) -> Result<Box<dyn Shader<Self> + 'a>>;

    /// [`SceneFile::background`].
    ///
    /// # Errors
    /// If a background file cannot be used.
    fn background_of(file: &SceneFile) -> Result<Box<dyn Background<Self>>>;
}

impl ScenePrecision for f32 {
    fn field_of(file: &SceneFile) -> Result<Box<dyn Field<f32>>> {
        field(file)
    }

    fn shader_of<'a>(
        file: &SceneFile,
        occluders: &'a dyn Field<f32>,
    ) -> Result<Box<dyn Shader<f32> + 'a>> {
        shader(file, occluders)
    }

    fn background_of(file: &SceneFile) -> Result<Box<dyn Background<f32>>> {
        file.background.build(file.origin)
    }
}

impl ScenePrecision for f64 {
    fn field_of(file: &SceneFile) -> Result<Box<dyn Field<f64>>> {
        field(file)
    }

    fn shader_of<'a>(
        file: &SceneFile,
        occluders: &'a dyn Field<f64>,
    ) -> Result<Box<dyn Shader<f64> + 'a>> {
        shader(file, occluders)
    }

    fn background_of(file: &SceneFile) -> Result<Box<dyn Background<f64>>> {
        file.background.build(file.origin)
    }
}

fn field<R: ScenePrecision>(file: &SceneFile) -> Result<Box<dyn Field<R>>> {
    let field = file.sdf.build(file.origin)?;
    Ok(match &file.clip {
        Some(ball) => Box::new(Clipped::new(field, in_precision(ball))),
        None => field,
    })
}

fn shader<'a, R: ScenePrecision>(
    file: &SceneFile,
    occluders: &'a dyn Field<R>,
) -> Result<Box<dyn Shader<R> + 'a>> {
    file.appearance.build(file.origin, occluders, in_precision(&file.bounds))
}
