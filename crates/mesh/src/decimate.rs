//! Meshes with fewer faces.

use meshopt_rs::simplify::simplify;

use crate::Mesh;
use crate::components::{Components, keep_components, select_faces, smallest_share};
use crate::manifold::make_manifold;
use crate::separate::separate;

/// The largest error of a collapse, relative to the extent of the mesh: the number of faces ends
/// the decimation, and not the error.
const LARGEST_ERROR: f32 = 1.0;

/// A piece with less than this share of the largest one's area is dropped: collapses pinch off
/// pieces of a few faces.
const LARGEST_PINCHED: f64 = 0.01;

/// Pieces as large as the components of the mesh are kept: the dropped ones have less than this
/// share of the area of the smallest component.
const OF_SMALLEST: f64 = 0.5;

/// A mesh with at most `faces` faces, as far as its topology allows.
///
/// Edges collapse in the order of their quadric errors (Garland, Heckbert, "Surface Simplification
/// Using Quadric Error Metrics", SIGGRAPH 1997), by the crate `meshopt-rs`. Vertices of the result
/// are vertices of the mesh, with their normals and colours. A closed mesh stays closed and a
/// manifold, and no two vertices are at one place: where a collapse makes sheets touch, they are
/// separated as after the extraction, which may add a few vertices and faces. Pieces of a few faces
/// that a collapse pinches off are dropped.
#[must_use]
pub fn decimate(mesh: &Mesh, faces: usize) -> Mesh {
    if mesh.faces.len() <= faces {
        return mesh.clone();
    }
    let points: Vec<[f32; 3]> = mesh.vertices.iter().map(|v| v.to_array()).collect();
    let indices = mesh.faces.as_flattened();
    let mut kept = vec![0; indices.len()];
    let count = simplify(&mut kept, indices, &points, 3 * faces, LARGEST_ERROR);
    kept.truncate(count);
    let faces = kept.chunks_exact(3).map(|f| [f[0], f[1], f[2]]).collect();
    let mut out = Mesh { faces: without_opposite(faces), ..mesh.clone() };
    out = select_faces(&out, |_| true);
    if mesh.is_closed() {
        make_manifold(&mut out);
        let pinched = LARGEST_PINCHED.min(OF_SMALLEST * smallest_share(mesh));
        out = keep_components(out, Components::AtLeast(pinched));
    }
    let mean_edge = (out.area() / out.faces.len().max(1) as f64).sqrt();
    separate(&mut out, mean_edge);
    out
}

/// Removes pairs of faces with the same vertices and opposite orientations: a wall without
/// thickness, which remains of a part that collapsed.
fn without_opposite(mut faces: Vec<[u32; 3]>) -> Vec<[u32; 3]> {
    /// The sorted vertices of a face, and whether the face has their orientation.
    fn sorted(face: &[u32; 3]) -> ([u32; 3], bool) {
        let mut sorted = *face;
        sorted.sort_unstable();
        let start = face.iter().position(|v| *v == sorted[0]).unwrap_or(0);
        (sorted, face[(start + 1) % 3] == sorted[1])
    }
    let mut order: Vec<usize> = (0..faces.len()).collect();
    order.sort_by_key(|i| sorted(&faces[*i]));
    let mut is_removed = vec![false; faces.len()];
    for same in order.chunk_by(|a, b| sorted(&faces[*a]).0 == sorted(&faces[*b]).0) {
        let reversed = same.iter().filter(|i| !sorted(&faces[**i]).1).count();
        let pairs = reversed.min(same.len() - reversed);
        // The reversed ones come first.
        same.iter().take(pairs).chain(same.iter().rev().take(pairs)).for_each(|i| {
            is_removed[*i] = true;
        });
    }
    let mut removed = is_removed.into_iter();
    faces.retain(|_| removed.next() == Some(false));
    faces
}
