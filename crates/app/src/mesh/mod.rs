//! Triangle meshes: extraction from a field, files, and what can be said of them.

mod components;
mod extract;
mod files;

pub use extract::extract;
pub use files::{read_mesh, write_mesh};

use std::collections::HashMap;

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

    /// The enclosed volume, cubic world units; positive if faces point outwards. Only a closed mesh has one.
    pub fn volume(&self) -> f64 {
        (0..self.faces.len()).map(|i| self.corners(i)[0].dot(self.face_cross(i)) / 6.0).sum()
    }

    /// How often each directed edge occurs.
    fn directed_edges(&self) -> HashMap<(u32, u32), u32> {
        let mut edges = HashMap::with_capacity(3 * self.faces.len());
        for [a, b, c] in &self.faces {
            for edge in [(*a, *b), (*b, *c), (*c, *a)] {
                *edges.entry(edge).or_insert(0) += 1;
            }
        }
        edges
    }

    /// Whether every edge is passed as often in one direction as in the other: no border.
    pub fn is_closed(&self) -> bool {
        let edges = self.directed_edges();
        !self.faces.is_empty() && edges.iter().all(|((a, b), n)| edges.get(&(*b, *a)) == Some(n))
    }

    /// V − E + F.
    pub fn euler_characteristic(&self) -> i64 {
        let edges = self
            .directed_edges()
            .keys()
            .map(|(a, b)| (a.min(b), a.max(b)))
            .collect::<std::collections::HashSet<_>>()
            .len();
        self.vertices.len() as i64 - edges as i64 + self.faces.len() as i64
    }

    /// The number of handles of a closed surface of one piece, (2 − χ)/2; nothing for other meshes.
    pub fn genus(&self) -> Option<i64> {
        let one = components::count(self) == 1;
        (one && self.is_closed()).then(|| (2 - self.euler_characteristic()) / 2)
    }
}

#[cfg(test)]
mod tests;
