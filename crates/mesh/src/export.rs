//! How a mesh is written to a file.

use glam::DVec3;

use crate::Texture;

/// The size, the direction and the texture of a mesh in a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Export<'a> {
    /// The factor on all lengths, finite and above 0.
    pub scale: f64,
    /// The direction that a .glb or a .usdz file shows upwards: a unit vector in the coordinates of the mesh.
    /// Files in other formats keep the axes of the mesh.
    pub up: DVec3,
    /// The texture of the mesh, in the place of its colours.
    pub texture: Option<&'a Texture>,
}

impl Default for Export<'_> {
    /// The mesh as it is: the factor 1, and the upward direction of glTF and USD, y.
    fn default() -> Self {
        Export { scale: 1.0, up: DVec3::Y, texture: None }
    }
}
