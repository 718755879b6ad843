//! Scene files: a camera, a field, an appearance, a background.

mod appearance;
mod sdf;

use std::path::Path;

use field::{Field, Real, Sphere, Vector3};
use glam::{DMat4, DVec2, DVec3};
use serde_json::Value;

pub use appearance::{Appearance, AppearanceModel};
pub use sdf::{Sdf, network};

use io::InputError;
use io::json::{Object, numbers};
use render::{Camera, Precision, Shader};

/// Everything a scene file says.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The camera.
    pub camera: Camera,
    /// The field.
    pub sdf: Sdf,
    /// How its surface looks.
    pub appearance: AppearanceModel,
    /// Radiance of rays that hit nothing, linear RGB.
    pub background: [f64; 3],
    /// Where tracing starts and ends.
    pub bounds: Sphere<f64>,
}

/// How far tracing starts outside a solid's own bounding ball, as a factor on its radius. The warp
/// field must live on both sides of every silhouette, so a ball that hugs the solid will not do; at
/// 1 the outline of a sphere would be the border of the traced region. A network's ball is where
/// the network exists and is taken as it is.
const BOUNDS_MARGIN: f64 = 1.5;

type Result<T> = std::result::Result<T, InputError>;

impl Scene {
    /// Reads a scene file.
    ///
    /// # Errors
    /// If the file, or a model file it names, is missing or wrong: with the place and what was
    /// expected.
    pub fn load(path: &Path) -> Result<Scene> {
        let text = std::fs::read_to_string(path)
            .map_err(|e| InputError::new(path, "scene", e, "a readable scene file"))?;
        let value = serde_json::from_str(&text)
            .map_err(|e| InputError::new(path, format!("line {}", e.line()), e, "a JSON object"))?;
        Self::from_value(path, &value)
    }

    /// Reads a scene from parsed JSON; `path` is the file it came from, for messages and relative
    /// paths.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn from_value(path: &Path, value: &Value) -> Result<Scene> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let root = Object::new(path, "", value)?;
        let camera = read_camera(root.object("camera")?)?;
        let sdf = Sdf::read(root.object("sdf")?, folder)?;
        let appearance = AppearanceModel::read(root.object("appearance")?, folder)?;
        let background = root.light("background")?;
        root.finish()?;
        let bounds = bounds(&sdf, &camera)?;
        Ok(Scene { camera, sdf, appearance, background, bounds })
    }

    /// Builds the appearance's shader; `occluders` is the scene's field, which blocks light where
    /// shadows are asked for.
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

fn bounds(sdf: &Sdf, camera: &Camera) -> Result<Sphere<f64>> {
    let field = sdf.build::<f64>()?;
    Ok(match field.bounds() {
        Some(ball) if matches!(sdf, Sdf::Neural { .. }) => ball,
        Some(ball) => ball.scaled(BOUNDS_MARGIN),
        // An unbounded solid is seen as far as a thousand times the camera's distance from the
        // origin.
        None => Sphere { center: camera.eye, radius: 1e3 * camera.eye.length().max(1.0) },
    })
}

fn read_camera(object: Object<'_>) -> Result<Camera> {
    let (width, height) = (object.size("width")?, object.size("height")?);
    let focal = match object.optional("focal") {
        Some(value) if value.is_array() => DVec2::from(object.numbers::<2>("focal")?),
        _ => DVec2::splat(object.number("focal")?),
    };
    if focal.min_element() <= 0.0 {
        return Err(object.error("focal", "a focal length above 0, in pixels"));
    }
    let principal = DVec2::from(object.numbers("principal")?);
    let camera = if let Some(pose) = object.optional("pose") {
        let rows = pose.as_array().filter(|rows| rows.len() == 4);
        let rows: Option<Vec<[f64; 4]>> = rows.and_then(|rows| rows.iter().map(numbers).collect());
        let rigid = "a 4 x 4 camera-to-world matrix, row-major, whose upper 3 x 3 is a rotation";
        rows.and_then(|r| {
            let matrix = DMat4::from_cols_array_2d(&[r[0], r[1], r[2], r[3]]).transpose();
            Camera::from_pose(width, height, focal, principal, matrix)
        })
        .ok_or_else(|| object.error("pose", rigid))?
    } else {
        let eye = DVec3::from(object.numbers("eye")?);
        let (target, up) =
            (DVec3::from(object.numbers("target")?), DVec3::from(object.numbers("up")?));
        Camera::look_at(width, height, focal, principal, eye, target, up).ok_or_else(|| {
            object.error("target", "a point away from eye, with up not along the view")
        })?
    };
    object.finish()?;
    Ok(camera)
}
