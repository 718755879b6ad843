//! The parts of a scene in single and in double precision, compiled once.

use field::{Background, Clipped, Field, Precision, Real, Shader, Sphere, Vector3};
use files::InputError;
use glam::DVec3;
use sdf_nn::Passes;

use crate::{AppearanceModel, BackgroundModel, Sdf};

/// A precision that the parts of a scene are built in: `f32` or `f64`.
///
/// Its functions are compiled in this crate. Generic functions would be compiled again, with every
/// shape and shader, in each crate that builds a scene. `origin` is the point that positions are
/// relative to, world units.
pub trait ScenePrecision: Precision + Passes {
    /// The field, cut off at a ball if `clip` has one: [`SceneFile::field`](crate::SceneFile::field).
    ///
    /// # Errors
    /// If a model file cannot be used.
    fn field(
        sdf: &Sdf,
        origin: DVec3,
        clip: Option<&Sphere<f64>>,
    ) -> Result<Box<dyn Field<Self>>, InputError>;

    /// [`SceneFile::shader`](crate::SceneFile::shader). `bounds` is the sphere in which rays are
    /// traced.
    ///
    /// # Errors
    /// If a model file cannot be used.
    fn shader<'a>(
        appearance: &AppearanceModel,
        origin: DVec3,
        occluders: &'a dyn Field<Self>,
        bounds: &Sphere<f64>,
    ) -> Result<Box<dyn Shader<Self> + 'a>, InputError>;

    /// [`SceneFile::background`](crate::SceneFile::background).
    ///
    /// # Errors
    /// If a background file cannot be used.
    fn background(
        background: &BackgroundModel,
        origin: DVec3,
    ) -> Result<Box<dyn Background<Self>>, InputError>;
}

impl ScenePrecision for f32 {
    fn field(
        sdf: &Sdf,
        origin: DVec3,
        clip: Option<&Sphere<f64>>,
    ) -> Result<Box<dyn Field<f32>>, InputError> {
        field(sdf, origin, clip)
    }

    fn shader<'a>(
        appearance: &AppearanceModel,
        origin: DVec3,
        occluders: &'a dyn Field<f32>,
        bounds: &Sphere<f64>,
    ) -> Result<Box<dyn Shader<f32> + 'a>, InputError> {
        appearance.build(origin, occluders, in_precision(bounds))
    }

    fn background(
        background: &BackgroundModel,
        origin: DVec3,
    ) -> Result<Box<dyn Background<f32>>, InputError> {
        background.build(origin)
    }
}

impl ScenePrecision for f64 {
    fn field(
        sdf: &Sdf,
        origin: DVec3,
        clip: Option<&Sphere<f64>>,
    ) -> Result<Box<dyn Field<f64>>, InputError> {
        field(sdf, origin, clip)
    }

    fn shader<'a>(
        appearance: &AppearanceModel,
        origin: DVec3,
        occluders: &'a dyn Field<f64>,
        bounds: &Sphere<f64>,
    ) -> Result<Box<dyn Shader<f64> + 'a>, InputError> {
        appearance.build(origin, occluders, in_precision(bounds))
    }

    fn background(
        background: &BackgroundModel,
        origin: DVec3,
    ) -> Result<Box<dyn Background<f64>>, InputError> {
        background.build(origin)
    }
}

fn field<R: ScenePrecision>(
    sdf: &Sdf,
    origin: DVec3,
    clip: Option<&Sphere<f64>>,
) -> Result<Box<dyn Field<R>>, InputError> {
    let field = sdf.build(origin)?;
    Ok(match clip {
        Some(ball) => Box::new(Clipped::new(field, in_precision(ball))),
        None => field,
    })
}

fn in_precision<R: Precision>(ball: &Sphere<f64>) -> Sphere<R> {
    Sphere {
        center: <R::Vec3 as Vector3<R>>::of(ball.center),
        radius: <R as Real>::of(ball.radius),
    }
}
