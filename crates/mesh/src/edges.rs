//! The edges of a mesh, sorted.
//!
//! Half-edge h = 3 f + k runs from corner k of face f to the next corner.

use rayon::slice::ParallelSliceMut;

use super::Mesh;

/// A half-edge under the two vertices it joins, the lower one first.
pub(super) type Edge = ([u32; 2], u32);

/// Where a half-edge starts and ends.
pub(super) fn ends(mesh: &Mesh, half: u32) -> [u32; 2] {
    let face = mesh.faces[half as usize / 3];
    let k = half as usize % 3;
    [face[k], face[(k + 1) % 3]]
}

/// All half-edges; those of one edge stand together.
pub(super) fn sorted(mesh: &Mesh) -> Vec<Edge> {
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
pub(super) fn same(a: &Edge, b: &Edge) -> bool {
    a.0 == b.0
}

/// Whether an edge has two half-edges, one each way.
pub(super) fn is_simple(mesh: &Mesh, edge: &[Edge]) -> bool {
    match edge {
        [a, b] => {
            let [start, end] = ends(mesh, a.1);
            start != end && ends(mesh, b.1) == [end, start]
        }
        _ => false,
    }
}
