//! The topology of a mesh: whether it is closed, its pieces and its handles.

use crate::{Mesh, components, edges};

impl Mesh {
    /// Whether each edge has exactly two half-edges, in opposite directions. False for a mesh
    /// without faces.
    pub fn is_closed(&self) -> bool {
        !self.faces.is_empty()
            && edges::sorted(self).chunk_by(edges::same).all(|e| edges::is_simple(self, e))
    }

    /// The Euler characteristic: vertices − edges + faces, without vertices that no face uses.
    pub fn euler_characteristic(&self) -> i64 {
        let mut used = vec![false; self.vertices.len()];
        self.faces.as_flattened().iter().for_each(|v| used[*v as usize] = true);
        let vertices = used.iter().filter(|u| **u).count() as i64;
        let edges = edges::sorted(self).chunk_by(edges::same).count() as i64;
        vertices - edges + self.faces.len() as i64
    }

    /// The number of connected components. The wall of a cavity is a component of its own; a vertex
    /// that no face uses is none.
    pub fn components(&self) -> usize {
        components::count(self)
    }

    /// The number of handles, (2 − χ)/2, of a closed mesh of one component; `None` for other
    /// meshes.
    pub fn genus(&self) -> Option<i64> {
        (self.components() == 1 && self.is_closed()).then(|| (2 - self.euler_characteristic()) / 2)
    }
}
