#![doc = include_str!("../README.md")]

mod appearance;
mod camera;
mod sdf;

use std::path::Path;

use field::{Field, Real, Sphere, Vector3};
use serde_json::Value;

pub use appearance::{Appearance, AppearanceModel};
pub use sdf::{Sdf, network};

use io::InputError;
use io::json::Object;
use render::{Camera, Precision, Shader};

/// The content of a scene file.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFile {
    /// The camera.
    pub camera: Camera,
    /// The signed distance field.
    pub sdf: Sdf,
    /// The appearance of the field's surface.
    pub appearance: AppearanceModel,
    /// Radiance of rays that hit nothing, linear RGB.
    pub background: [f64; 3],
    /// The sphere in which rays are traced, world units.
    pub bounds: Sphere<f64>,
}

/// Radius of the tracing sphere of an analytic solid, in radii of the solid's own bounding ball.
///
/// A warp field needs traced points on both sides of every silhouette. At 1, the silhouette of a
/// lone sphere would be the border of the traced region. A network's ball is used unscaled, because
/// the network is not defined outside it.
const BOUNDS_MARGIN: f64 = 1.5;

/// Radius of the tracing sphere of an unbounded solid, in distances of the eye from the origin. A
/// distance below 1 world unit counts as 1.
const UNBOUNDED_REACH: f64 = 1e3;

type Result<T> = std::result::Result<T, InputError>;

impl SceneFile {
    /// Reads a scene file.
    ///
    /// # Errors
    /// If the file, or a model file that it names, is missing or wrong. The error holds the place
    /// in the file, the value found and the value expected.
    pub fn load(path: &Path) -> Result<SceneFile> {
        let text = std::fs::read_to_string(path)
            .map_err(|e| InputError::new(path, "scene", e, "a readable scene file"))?;
        let value = serde_json::from_str(&text)
            .map_err(|e| InputError::new(path, format!("line {}", e.line()), e, "a JSON object"))?;
        Self::from_value(path, &value)
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
        let background = root.light("background")?;
        root.finish()?;
        let bounds = bounds(&sdf, &camera)?;
        Ok(SceneFile { camera, sdf, appearance, background, bounds })
    }

    /// Builds the shader of the appearance.
    ///
    /// `occluders` is the scene's field. It blocks lights if the appearance has shadows, and is
    /// unused otherwise.
    ///
    /// # Errors
    /// If a model file cannot be used.
    pub fn shader<'a, R: Precision>(
        &self,
        occluders: &'a dyn Field<R>,
    ) -> Result<Box<dyn Shader<R> + 'a>> {
        let bounds = Sphere {
            center: <R::Vec3 as Vector3<R>>::of(self.bounds.center),
            radius: <R as Real>::of(self.bounds.radius),
        };
        self.appearance.build(occluders, bounds)
    }
}

/// The tracing sphere: around a bounded solid, else around the eye.
fn bounds(sdf: &Sdf, camera: &Camera) -> Result<Sphere<f64>> {
    let field = sdf.build::<f64>()?;
    Ok(match field.bounds() {
        Some(ball) if matches!(sdf, Sdf::Neural { .. }) => ball,
        Some(ball) => ball.scaled(BOUNDS_MARGIN),
        None => {
            Sphere { center: camera.eye, radius: UNBOUNDED_REACH * camera.eye.length().max(1.0) }
        }
    })
}
