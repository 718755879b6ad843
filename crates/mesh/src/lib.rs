//! Triangle meshes: extraction from a field, files, and what can be said of them.
//!
//! A mesh here is a list of vertices (world units) and of triangles, counter-clockwise seen from
//! outside. It is *closed* if every edge is shared by exactly two triangles that pass it in
//! opposite directions. What [`extract`] returns is closed and a manifold: the triangles around a
//! vertex form one fan.

mod components;
mod edges;
mod extract;
mod grid;
mod manifold;
mod project;
mod read;
mod write;

pub use components::Components;
pub use extract::{extract, extract_with};
pub use read::read_mesh;
pub use write::write_mesh;

use std::path::Path;

use glam::{DVec3, Vec3};

/// A triangle mesh; faces are counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions, world units.
    pub vertices: Vec<Vec3>,
    /// Unit vertex normals, or nothing.
    pub normals: Vec<Vec3>,
    /// Indices of each triangle's vertices.
    pub faces: Vec<[u32; 3]>,
}

impl Mesh {
    /// The corners of face `i` in double precision.
    pub fn corners(&self, i: usize) -> [DVec3; 3] {
        self.faces[i].map(|v| self.vertices[v as usize].as_dvec3())
    }

    /// Twice the area of face `i` times its unit normal.
    pub fn face_cross(&self, i: usize) -> DVec3 {
        let [a, b, c] = self.corners(i);
        (b - a).cross(c - a)
    }

    /// The surface area, square world units.
    pub fn area(&self) -> f64 {
        (0..self.faces.len()).map(|i| 0.5 * self.face_cross(i).length()).sum()
    }

    /// The enclosed volume, cubic world units; positive if faces point outwards. Only a closed mesh
    /// has one.
    pub fn volume(&self) -> f64 {
        // About a vertex rather than the origin, so that a small mesh far away keeps its digits.
        let about = self.vertices.first().map_or(DVec3::ZERO, |v| v.as_dvec3());
        (0..self.faces.len())
            .map(|i| (self.corners(i)[0] - about).dot(self.face_cross(i)) / 6.0)
            .sum()
    }

    /// Whether every edge is shared by exactly two faces, which pass it in opposite directions.
    pub fn is_closed(&self) -> bool {
        !self.faces.is_empty()
            && edges::sorted(self).chunk_by(edges::same).all(|e| edges::is_simple(self, e))
    }

    /// V − E + F, over the vertices that a face uses.
    pub fn euler_characteristic(&self) -> i64 {
        let mut used = vec![false; self.vertices.len()];
        self.faces.as_flattened().iter().for_each(|v| used[*v as usize] = true);
        let vertices = used.iter().filter(|u| **u).count() as i64;
        let edges = edges::sorted(self).chunk_by(edges::same).count() as i64;
        vertices - edges + self.faces.len() as i64
    }

    /// The number of connected pieces; a cavity's wall is a piece of its own.
    pub fn components(&self) -> usize {
        components::count(self)
    }

    /// The number of handles of a closed surface of one piece, (2 − χ)/2; nothing for other meshes.
    pub fn genus(&self) -> Option<i64> {
        (self.components() == 1 && self.is_closed()).then(|| (2 - self.euler_characteristic()) / 2)
    }
}

fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase()
}

#[cfg(test)]
mod file_tests;
#[cfg(test)]
mod tests;
