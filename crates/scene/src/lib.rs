#![doc = include_str!("../README.md")]

mod appearance;
mod background;
mod camera;
mod precision;
mod sdf;
pub mod synth;

use std::path::Path;

use field::{Field, Sphere};
use glam::DVec3;
use serde_json::Value;

pub use appearance::{Appearance, AppearanceModel};
pub use background::BackgroundModel;
pub use precision::ScenePrecision;
pub use sdf::{Sdf, network};

use field::{Background, Shader};
use files::InputError;
use files::json::Object;
use render::Camera;

/// The content of a scene file.
///
/// Camera, bounds, field and shader are in coordinates relative to [`origin`](Self::origin).
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFile {
    /// The point that positions are relative to, world units: see [`Sphere::precise_origin`].
    pub origin: DVec3,
    /// The camera.
    pub camera: Camera,
    /// The signed distance field.
    pub sdf: Sdf,
    /// The appearance of the field's surface.
    pub appearance: AppearanceModel,
    /// The radiance of rays that hit nothing.
    pub background: BackgroundModel,
    /// The sphere in which rays are traced, world units.
    pub bounds: Sphere<f64>,
    /// The ball that an unbounded solid is clipped to, world units; `None` for a bounded solid.
    pub clip: Option<Sphere<f64>>,
}

/// Radius of the tracing sphere of an analytic solid, in radii of the solid's own bounding ball.
///
/// A warp field needs traced points on both sides of every silhouette. At 1, the silhouette of a
/// lone sphere would be the border of the traced region. A network's ball is used unscaled, because
/// the network is not defined outside it.
const BOUNDS_MARGIN: f64 = 1.5;

/// Radius of the ball of an unbounded solid, in distances from the eye to the surface. The edge of
/// a floor, as seen from above it, is 1e-4 radians below the horizon.
const REACH_OF_SURFACE: f64 = 1e4;

/// Radius of the ball of an unbounded solid, in distances from the eye to the far side of its
/// furthest bounded part.
const REACH_OF_PARTS: f64 = 1e3;

type Result<T> = std::result::Result<T, InputError>;

impl SceneFile {
    /// Reads a scene file.
    ///
    /// # Errors
    /// If the file, or a model file that it names, is missing or wrong. The error holds the place
    /// in the file, the value found and the value expected.
    pub fn load(path: &Path) -> Result<SceneFile> {
        Self::from_value(path, &files::json::read(path)?)
    }

    /// Reads a scene from parsed JSON.
    ///
    /// `path` is the file that the JSON came from. Error messages name it, and relative paths of
    /// model files start at its folder. The file itself is not read.
    ///
    /// # Errors
    /// As [`SceneFile::load`].
    pub fn from_value(path: &Path, value: &Value) -> Result<SceneFile> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let root = Object::new(path, "", value)?;
        let camera = camera::read(root.object("camera")?)?;
        let sdf = Sdf::read(root.object("sdf")?, folder)?;
        let appearance = AppearanceModel::read(root.object("appearance")?, folder)?;
        let background = BackgroundModel::read(&root, folder)?;
        root.finish()?;
        let own_ball = sdf.build::<f64>(DVec3::ZERO)?.bounds();
        let mut ball = match own_ball {
            Some(ball) => ball,
            None => unbounded_ball(&sdf, camera.eye)?,
        };
        let origin = ball.precise_origin();
        ball.center -= origin;
        let camera = camera.about(origin);
        let clip = own_ball.is_none().then_some(ball);
        let bounds = ball.scaled(bounds_margin(&sdf));
        Ok(SceneFile { origin, camera, sdf, appearance, background, bounds, clip })
    }

    /// Builds the field in single or double precision.
    ///
    /// # Errors
    /// If a model file cannot be used.
    pub fn field<R: ScenePrecision>(&self) -> Result<Box<dyn Field<R>>> {
        R::field(&self.sdf, self.origin, self.clip.as_ref())
    }

    /// Builds the shader of the appearance.
    ///
    /// `occluders` is the scene's field. It blocks lights if the appearance has shadows, and is
    /// unused otherwise.
    ///
    /// # Errors
    /// If a model file cannot be used.
    pub fn shader<'a, R: ScenePrecision>(
        &self,
        occluders: &'a dyn Field<R>,
    ) -> Result<Box<dyn Shader<R> + 'a>> {
        R::shader(&self.appearance, self.origin, occluders, &self.bounds)
    }

    /// Builds the background in single or double precision.
    ///
    /// # Errors
    /// If a background file cannot be used.
    pub fn background<R: ScenePrecision>(&self) -> Result<Box<dyn Background<R>>> {
        R::background(&self.background, self.origin)
    }
}

/// Reads the `camera` object of a scene file on its own. `path` is the name in error messages.
///
/// # Errors
/// If a number is missing or wrong.
pub fn camera(path: &Path, value: &Value) -> Result<Camera> {
    camera::read(Object::new(path, "", value)?)
}

/// The radius of the tracing sphere in radii of the solid's ball: it has room around the solid, but
/// for a network inside of its own ball.
fn bounds_margin(sdf: &Sdf) -> f64 {
    if matches!(sdf, Sdf::Neural { clipped: false, .. }) { 1.0 } else { BOUNDS_MARGIN }
}

/// The ball of an unbounded solid: about the eye, far outside everything that the scene shows.
fn unbounded_ball(sdf: &Sdf, eye: DVec3) -> Result<Sphere<f64>> {
    let mut distance = [0.0];
    sdf.build::<f64>(eye)?.value(&[DVec3::ZERO], &mut distance);
    let parts = sdf.bounded_parts(eye)?;
    let furthest = parts.iter().map(|part| part.center.length() + part.radius).fold(0.0, f64::max);
    let radius = (REACH_OF_SURFACE * distance[0].abs()).max(REACH_OF_PARTS * furthest);
    let radius = if radius > 0.0 && radius.is_finite() { radius } else { REACH_OF_SURFACE };
    Ok(Sphere { center: eye, radius })
}
