//! Cuts of meshes: by photographs, by boxes and spheres, and by the plane of a table.

mod cutter;
mod masks;
mod plane;
#[cfg(test)]
mod plane_tests;
mod region;
mod report;
mod visible;
#[cfg(test)]
mod visible_tests;

pub use cutter::{Cutter, Step};
pub use masks::inside_masks;
pub use plane::{Ground, Plane, ground};
pub use region::Region;
pub use report::{CutReport, PlaneReport};
pub use visible::{mark_seen, seen_vertices, vertices_with_normals};
