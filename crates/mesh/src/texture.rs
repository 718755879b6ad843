//! An image on the faces of a mesh.

use film::Film;
use glam::{Vec2, Vec3};

use crate::Mesh;

/// An image, and the place of each face of a mesh in it.
///
/// A vertex on a seam, where the surface is cut to lie flat, has several points in the image.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Linear RGB from 0 to 1.
    pub image: Film,
    /// Points of the image: (0, 0) is its top left corner, (1, 1) its bottom right corner.
    pub points: Vec<Vec2>,
    /// The vertex of the mesh at each point.
    pub vertices: Vec<u32>,
    /// The points of the three corners of each face, in the order of the face's vertices.
    pub corners: Vec<[u32; 3]>,
}

impl Texture {
    /// The mesh with one vertex for each point of the image, as formats need it that have one list
    /// for positions and points. It has no colours, and borders at the seams.
    ///
    /// # Panics
    /// If a vertex of the texture is beyond those of the mesh.
    pub(crate) fn split(&self, mesh: &Mesh) -> Mesh {
        let split = |of: &[Vec3]| self.vertices.iter().map(|v| of[*v as usize]).collect();
        Mesh {
            origin: mesh.origin,
            vertices: split(&mesh.vertices),
            normals: if mesh.has_normals() { split(&mesh.normals) } else { Vec::new() },
            colors: Vec::new(),
            faces: self.corners.clone(),
        }
    }
}
