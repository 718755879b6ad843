//! The size of each cut, as numbers and as text.

use glam::DVec3;
use serde::Serialize;

use crate::cut::Ground;

/// The number of faces, and the part of the area, that a cut removed.
#[derive(Clone, Debug, Serialize)]
pub struct CutReport {
    /// `seen`, `masks`, `crop`, `above` or `pieces`.
    pub by: &'static str,
    /// The number of removed faces.
    pub faces: usize,
    /// Their part of the area before all cuts, 0 to 1.
    pub area: f64,
    /// The plane of the table, for `above`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plane: Option<PlaneReport>,
}

/// The plane of a table.
#[derive(Clone, Debug, Serialize)]
pub struct PlaneReport {
    /// A point of it, in data set units.
    pub point: [f64; 3],
    /// The unit normal of its upper side.
    pub normal: [f64; 3],
    /// Its angle to the cameras' mean upward direction, in degrees.
    pub degrees: f64,
    /// The part of the seen area that lies on it, 0 to 1.
    pub share: f64,
}

impl CutReport {
    /// The report as one line.
    pub fn text(&self) -> String {
        let name = match self.by {
            "seen" => "not seen by a photograph",
            "masks" => "outside the masks",
            "crop" => "outside the region",
            "above" => "table and below",
            _ => "small pieces left over",
        };
        let plane = self.plane.as_ref().map_or(String::new(), |plane| {
            let [x, y, z] = plane.normal;
            format!(
                "; the table has {:.1} % of the seen area, its normal is ({x:.3}, {y:.3}, {z:.3}), \
                 {:.1} degrees off the cameras' upward direction",
                100.0 * plane.share,
                plane.degrees
            )
        });
        let area = 100.0 * self.area;
        format!("cut off: {name}: {} faces, {area:.2} % of the area{plane}", self.faces)
    }
}

impl PlaneReport {
    /// The plane of a table that was found on a mesh. `origin` is that of the mesh.
    pub fn new(found: &Ground, origin: DVec3) -> Self {
        PlaneReport {
            point: (origin + found.plane.point).to_array(),
            normal: found.plane.normal.to_array(),
            degrees: found.degrees,
            share: found.share,
        }
    }
}
