//! The mesh type and its measures.

use film::srgb_encode;
use glam::{DVec3, Vec3};

/// A triangle mesh; the vertices of a face are counter-clockwise as seen from outside.
///
/// The methods panic if a face has an index beyond the vertices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// The point that the vertices are relative to, world units.
    pub origin: DVec3,
    /// Vertex positions relative to `origin`, world units.
    pub vertices: Vec<Vec3>,
    /// Unit normals, one per vertex, or empty.
    pub normals: Vec<Vec3>,
    /// Radiances, linear RGB from 0 to 1, one per vertex, or empty.
    pub colors: Vec<Vec3>,
    /// The indices of the three vertices of each face.
    pub faces: Vec<[u32; 3]>,
}

impl Mesh {
    /// Whether every vertex has a normal.
    pub(crate) fn has_normals(&self) -> bool {
        !self.normals.is_empty() && self.normals.len() == self.vertices.len()
    }

    /// Whether every vertex has a colour.
    pub(crate) fn has_colors(&self) -> bool {
        !self.colors.is_empty() && self.colors.len() == self.vertices.len()
    }

    /// Whether positions in world units need double precision.
    pub(crate) fn is_far(&self) -> bool {
        self.origin != DVec3::ZERO
    }

    /// The sRGB values of the colour of vertex `i`, 0 to 1.
    pub(crate) fn srgb(&self, i: usize) -> [f32; 3] {
        self.colors[i].to_array().map(|c| srgb_encode(c.clamp(0.0, 1.0)).clamp(0.0, 1.0))
    }

    /// The corners of face `i` relative to `origin`, world units, in double precision.
    pub fn corners(&self, i: usize) -> [DVec3; 3] {
        self.faces[i].map(|v| self.vertices[v as usize].as_dvec3())
    }

    /// The same mesh with vertices relative to `origin`, a point in world units.
    #[must_use]
    pub fn about(mut self, origin: DVec3) -> Self {
        let step = self.origin - origin;
        for v in self.vertices.iter_mut().filter(|_| step != DVec3::ZERO) {
            *v = (v.as_dvec3() + step).as_vec3();
        }
        Mesh { origin, ..self }
    }

    /// The same mesh with all lengths times `factor`.
    #[must_use]
    pub(crate) fn scaled(mut self, factor: f64) -> Self {
        for v in self.vertices.iter_mut().filter(|_| factor != 1.0) {
            *v = (v.as_dvec3() * factor).as_vec3();
        }
        Mesh { origin: self.origin * factor, ..self }
    }

    /// A mesh of vertices in world units, without faces. They become relative to their centre where
    /// that is further from the world's origin than from them.
    pub(crate) fn of_vertices(vertices: &[DVec3]) -> Self {
        let start = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = vertices.iter().fold(start, |(l, h), v| (l.min(*v), h.max(*v)));
        let center = 0.5 * (low + high);
        let is_far = center.is_finite() && center.length() > 0.5 * (high - low).length();
        let origin = if is_far { center } else { DVec3::ZERO };
        let vertices = vertices.iter().map(|v| (*v - origin).as_vec3()).collect();
        Mesh { origin, vertices, ..Mesh::default() }
    }

    /// The outward normal of face `i` with twice the face's area as its length, square world units.
    pub fn face_cross(&self, i: usize) -> DVec3 {
        let [a, b, c] = self.corners(i);
        (b - a).cross(c - a)
    }

    /// The surface area, square world units.
    pub fn area(&self) -> f64 {
        (0..self.faces.len()).map(|i| 0.5 * self.face_cross(i).length()).sum()
    }

    /// The area that each vertex stands for, square world units: a third of that of its faces.
    pub fn vertex_areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.vertices.len()];
        for (i, face) in self.faces.iter().enumerate() {
            let third = self.face_cross(i).length() / 6.0;
            face.iter().for_each(|v| areas[*v as usize] += third);
        }
        areas
    }

    /// The enclosed volume of a closed mesh, cubic world units; positive if the faces point
    /// outwards. The result has no meaning for a mesh that is not closed.
    pub fn volume(&self) -> f64 {
        // The sum of signed tetrahedra from one point to all faces. The point is a vertex rather
        // than the origin, so that a small mesh far from the origin keeps its digits.
        let apex = self.vertices.first().map_or(DVec3::ZERO, |v| v.as_dvec3());
        (0..self.faces.len()).map(|i| self.volume_to(i, apex)).sum()
    }

    /// The volume of the tetrahedron of face `i` and `apex`, positive if the face points away.
    pub(crate) fn volume_to(&self, i: usize, apex: DVec3) -> f64 {
        (self.corners(i)[0] - apex).dot(self.face_cross(i)) / 6.0
    }
}
