//! A pinhole camera.

use glam::{DVec2, DVec3};
use serde_json::Value;

/// A pinhole camera that looks at a point.
pub(crate) struct Camera {
    pub(crate) size: [usize; 2],
    focal: f64,
    principal: DVec2,
    pub(crate) eye: DVec3,
    /// The directions of growing film x, of growing film y and of the view.
    axes: [DVec3; 3],
}

/// Three numbers of a JSON array.
pub(crate) fn vector(value: &Value) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|i| value[i].as_f64().unwrap()))
}

impl Camera {
    /// The camera of a scene file.
    pub(crate) fn of(scene: &Value) -> Self {
        let camera = &scene["camera"];
        let number = |value: &Value| value.as_f64().unwrap();
        let size = ["width", "height"].map(|side| camera[side].as_u64().unwrap() as usize);
        let principal = &camera["principal"];
        let eye = vector(&camera["eye"]);
        let view = (vector(&camera["target"]) - eye).normalize();
        let right = view.cross(vector(&camera["up"])).normalize();
        Camera {
            size,
            focal: number(&camera["focal"]),
            principal: DVec2::new(number(&principal[0]), number(&principal[1])),
            eye,
            axes: [right, view.cross(right), view],
        }
    }

    /// The unit direction of the ray through a film position, in pixels.
    pub(crate) fn direction(&self, u: DVec2) -> DVec3 {
        let at = (u - self.principal) / self.focal;
        (self.axes[0] * at.x + self.axes[1] * at.y + self.axes[2]).normalize()
    }
}
