//! The radiance of surfaces and of the background.

use glam::DVec3;
use serde_json::Value;

use super::camera::vector;
use super::rows::Seen;

/// The appearance and the background of a scene file.
pub(crate) struct Look {
    background: DVec3,
    paint: Paint,
}

enum Paint {
    /// The same radiance everywhere.
    Even(DVec3),
    /// A Lambertian surface. A lamp has its unit direction and its radiance.
    Lambert { ambient: DVec3, albedo: DVec3, lamps: Vec<[DVec3; 2]> },
}

impl Look {
    pub(crate) fn of(scene: &Value) -> Self {
        let appearance = &scene["appearance"];
        let lamp =
            |lamp: &Value| [vector(&lamp["direction"]).normalize(), vector(&lamp["radiance"])];
        let paint = match appearance["type"].as_str().unwrap() {
            "constant" => Paint::Even(vector(&appearance["radiance"])),
            "lambert" => Paint::Lambert {
                ambient: vector(&appearance["ambient"]),
                albedo: vector(&appearance["albedo"]),
                lamps: appearance["lights"].as_array().unwrap().iter().map(lamp).collect(),
            },
            other => panic!("{other}"),
        };
        Look { background: vector(&scene["background"]), paint }
    }

    /// Whether the radiance of the surface is the same everywhere.
    pub(crate) fn is_even(&self) -> bool {
        matches!(self.paint, Paint::Even(_))
    }

    /// The part of a smooth surface that lies in the light of the same lamps, and its radiance. The
    /// lamps are directional. Derivatives of the radiance jump between parts.
    pub(crate) fn lit(&self, normal: DVec3) -> (u32, DVec3) {
        let (ambient, albedo, lamps) = match &self.paint {
            Paint::Even(radiance) => return (0, *radiance),
            Paint::Lambert { ambient, albedo, lamps } => (*ambient, *albedo, lamps),
        };
        let (mut part, mut light) = (0, ambient);
        for (number, [direction, radiance]) in lamps.iter().enumerate() {
            let cosine = normal.dot(*direction);
            light += *radiance * cosine.max(0.0);
            part |= u32::from(cosine > 0.0) << number;
        }
        (part, albedo * light)
    }

    /// The background along a ray.
    pub(crate) fn nothing(&self) -> Seen {
        Seen { face: 0, t: f64::INFINITY, radiance: self.background }
    }
}
