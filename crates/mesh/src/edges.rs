//! The edges of a mesh as groups of half-edges.
//!
//! Half-edge h = 3 f + k runs from corner k of face f to its next corner.

use rayon::slice::ParallelSliceMut;

use crate::Mesh;

/// The two vertices that a half-edge joins, the lower index first, and the half-edge.
pub(crate) type Edge = ([u32; 2], u32);

/// The vertices at which a half-edge starts and ends.
pub(crate) fn ends(mesh: &Mesh, half: u32) -> [u32; 2] {
    let face = mesh.faces[half as usize / 3];
    let k = half as usize % 3;
    [face[k], face[(k + 1) % 3]]
}

/// All half-edges, sorted: those of one edge are neighbours.
pub(crate) fn sorted(mesh: &Mesh) -> Vec<Edge> {
    let mut edges: Vec<Edge> = (0..3 * mesh.faces.len() as u32)
        .map(|half| {
            let [a, b] = ends(mesh, half);
            ([a.min(b), a.max(b)], half)
        })
        .collect();
    edges.par_sort_unstable();
    edges
}

/// Whether two half-edges belong to one edge.
pub(crate) fn same(a: &Edge, b: &Edge) -> bool {
    a.0 == b.0
}

/// Whether an edge has exactly two half-edges, in opposite directions.
pub(crate) fn is_simple(mesh: &Mesh, edge: &[Edge]) -> bool {
    match edge {
        [a, b] => {
            let [start, end] = ends(mesh, a.1);
            start != end && ends(mesh, b.1) == [end, start]
        }
        _ => false,
    }
}
