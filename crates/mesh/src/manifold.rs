//! From a surface that touches itself to a manifold.
//!
//! Surface nets put one vertex into a cell, also where two sheets of the surface cross it. The
//! sheets then share a vertex, or an edge with four faces. Each edge still has as many half-edges
//! in one direction as in the other. So its half-edges can be paired: the two of a pair are twins,
//! and their faces are neighbours. The twins tell which corners are neighbours around a vertex.
//! Each class of connected corners gets a vertex of its own. This is the operation "cutting" of A.
//! Guéziec, G. Taubin, F. Lazarus, B. Horn, "Cutting and Stitching: Converting Sets of Polygons to
//! Manifold Surfaces", IEEE Transactions on Visualization and Computer Graphics 2001.

use glam::DVec3;

use crate::Mesh;
use crate::components::DisjointSets;
use crate::edges::{self, Edge};

/// Stands for a missing half-edge or vertex.
const NONE: u32 = u32::MAX;

/// Makes the mesh a manifold.
///
/// Each edge with as many half-edges in one direction as in the other becomes simple, and the faces
/// around each vertex become one fan. The surface as a set of points stays the same.
pub(crate) fn make_manifold(mesh: &mut Mesh) {
    let mut twins = twins(mesh);
    split_vertices(mesh, &twins);
    while split_double_edges(mesh, &mut twins) {}
}

/// The twin of each half-edge: the opposite half-edge in the neighbouring face.
fn twins(mesh: &Mesh) -> Vec<u32> {
    let mut twins = vec![NONE; 3 * mesh.faces.len()];
    for edge in edges::sorted(mesh).chunk_by(edges::same) {
        if edges::is_simple(mesh, edge) {
            pair(&mut twins, edge[0].1, edge[1].1);
        } else {
            pair_by_angle(mesh, edge, &mut twins);
        }
    }
    twins
}

fn pair(twins: &mut [u32], a: u32, b: u32) {
    (twins[a as usize], twins[b as usize]) = (b, a);
}

/// Pairs the faces around one edge that bound the same wedge of the solid. So solids that touch at
/// the edge are separated there.
fn pair_by_angle(mesh: &Mesh, edge: &[Edge], twins: &mut [u32]) {
    let [low, high] = edge[0].0.map(|v| mesh.vertices[v as usize].as_dvec3());
    let axis = (high - low).try_normalize().unwrap_or(DVec3::X);
    let (u, v) = axis.any_orthonormal_pair();
    let mut around: Vec<(f64, u32)> =
        edge.iter().map(|(_, half)| (angle(mesh, *half, low, u, v), *half)).collect();
    around.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    // In the order of angles, a wedge of the solid begins at a face that runs from `high` to `low`,
    // and ends at the next face that runs from `low` to `high`. A wedge may contain the angle 0, so
    // the faces are passed twice.
    let begins_wedge = |half: u32| edges::ends(mesh, half)[0] == edge[0].0[1];
    let mut open = Vec::new();
    for pass in 0..2 {
        for (_, half) in &around {
            if pass == 0 && begins_wedge(*half) {
                open.push(*half);
            } else if !begins_wedge(*half)
                && twins[*half as usize] == NONE
                && let Some(start) = open.pop()
            {
                pair(twins, start, *half);
            }
        }
    }
}

/// The angle of a half-edge's face about its edge, in radians; `u`, `v` and the edge are
/// right-handed.
fn angle(mesh: &Mesh, half: u32, origin: DVec3, u: DVec3, v: DVec3) -> f64 {
    let face = mesh.faces[half as usize / 3];
    let opposite = mesh.vertices[face[(half as usize + 2) % 3] as usize].as_dvec3() - origin;
    opposite.dot(v).atan2(opposite.dot(u))
}

/// Gives each class of connected corners its own vertex. The first class at a vertex keeps it.
fn split_vertices(mesh: &mut Mesh, twins: &[u32]) {
    let mut classes = corner_classes(twins);
    let mut is_taken = vec![false; mesh.vertices.len()];
    let mut vertex_of_class = vec![NONE; twins.len()];
    for corner in 0..twins.len() as u32 {
        let class = classes.find(corner) as usize;
        let old = mesh.faces[corner as usize / 3][corner as usize % 3];
        if vertex_of_class[class] == NONE {
            vertex_of_class[class] = old;
            if is_taken[old as usize] {
                vertex_of_class[class] = mesh.vertices.len() as u32;
                push_middle(mesh, old, old);
            }
            is_taken[old as usize] = true;
        }
        mesh.faces[corner as usize / 3][corner as usize % 3] = vertex_of_class[class];
    }
}

/// The classes of corners that are connected around a vertex. A half-edge stands for the corner at
/// which it starts.
fn corner_classes(twins: &[u32]) -> DisjointSets {
    let next = |half: u32| half - half % 3 + (half + 1) % 3;
    let mut classes = DisjointSets::new(twins.len());
    for (half, twin) in twins.iter().enumerate().filter(|(_, t)| **t != NONE) {
        classes.union(half as u32, next(*twin));
    }
    classes
}

/// Splits edges with more than one pair of twins: all pairs but one get a vertex at the middle of
/// the edge.
///
/// Two pairs may still have the same two end vertices after vertices were split. A call is one
/// round, in which each face changes once at most. Returns false if there was no such edge.
fn split_double_edges(mesh: &mut Mesh, twins: &mut Vec<u32>) -> bool {
    let edges = edges::sorted(mesh);
    let double_edges = edges.chunk_by(edges::same).filter(|e| e.len() > 2);
    let is_first_of_pair = |e: &&Edge| twins[e.1 as usize] != NONE && e.1 < twins[e.1 as usize];
    let excess: Vec<u32> =
        double_edges.flat_map(|e| e.iter().filter(is_first_of_pair).skip(1)).map(|e| e.1).collect();
    let mut is_changed = vec![false; mesh.faces.len()];
    for half in &excess {
        let faces = [*half, twins[*half as usize]].map(|h| h as usize / 3);
        if faces.iter().all(|f| !is_changed[*f]) {
            faces.iter().for_each(|f| is_changed[*f] = true);
            split_edge(mesh, twins, *half);
        }
    }
    !excess.is_empty()
}

/// Splits the edge of a half-edge and its twin at the middle, and with it both faces.
fn split_edge(mesh: &mut Mesh, twins: &mut Vec<u32>, half: u32) {
    let [a, b] = edges::ends(mesh, half);
    let middle = mesh.vertices.len() as u32;
    push_middle(mesh, a, b);
    let old = [half, twins[half as usize]];
    let new = old.map(|h| split_face(mesh, twins, h, middle));
    pair(twins, old[0], new[1]);
    pair(twins, old[1], new[0]);
}

/// Adds a vertex in the middle of two, which may be the same.
fn push_middle(mesh: &mut Mesh, a: u32, b: u32) {
    let (a, b) = (a as usize, b as usize);
    mesh.vertices.push(mesh.vertices[a].midpoint(mesh.vertices[b]));
    if let (Some(m), Some(n)) = (mesh.normals.get(a), mesh.normals.get(b)) {
        mesh.normals.push((*m + *n).normalize_or(*m));
    }
    if let (Some(m), Some(n)) = (mesh.colors.get(a), mesh.colors.get(b)) {
        mesh.colors.push(m.midpoint(*n));
    }
}

/// Splits the face (a, b, c) of the half-edge (a, b): it becomes (a, middle, c), and a new face
/// (middle, b, c) is added. Returns the half-edge (middle, b).
fn split_face(mesh: &mut Mesh, twins: &mut Vec<u32>, half: u32, middle: u32) -> u32 {
    let (face, k) = (half as usize / 3, half as usize % 3);
    let [b, c] = [1, 2].map(|i| mesh.faces[face][(k + i) % 3]);
    mesh.faces[face][(k + 1) % 3] = middle;
    let added = 3 * mesh.faces.len() as u32;
    mesh.faces.push([middle, b, c]);
    twins.extend([NONE; 3]);
    // The half-edge that ran from b to c now runs from the middle to c. The new face takes over the
    // twin across b c.
    let side = (3 * face + (k + 1) % 3) as u32;
    let across = twins[side as usize];
    if across != NONE {
        pair(twins, added + 1, across);
    }
    pair(twins, side, added + 2);
    added
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Two tetrahedra share an edge: the edge has four faces, and each of its ends has two fans.
    #[test]
    fn solids_that_share_an_edge_are_separated() {
        let mut mesh = tetrahedron([0, 1, 2, 3]);
        mesh.faces.extend(tetrahedron([0, 1, 4, 5]).faces);
        mesh.vertices = [[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 1, 0], [-1, 0, 0], [-1, -1, 0]]
            .map(|v: [i32; 3]| Vec3::from(v.map(|c| c as f32)))
            .to_vec();
        assert!(!mesh.is_closed());
        let volume = mesh.volume();
        make_manifold(&mut mesh);
        assert!(mesh.is_closed());
        assert_eq!(
            (mesh.vertices.len(), mesh.components(), mesh.euler_characteristic()),
            (8, 2, 4)
        );
        assert_eq!(mesh.volume(), volume);
    }

    fn tetrahedron([a, b, c, d]: [u32; 4]) -> Mesh {
        Mesh { faces: vec![[a, c, b], [a, b, d], [a, d, c], [b, c, d]], ..Mesh::default() }
    }

    #[test]
    fn splitting_an_edge_keeps_the_surface_closed() {
        let mut mesh = tetrahedron([0, 1, 2, 3]);
        mesh.vertices = vec![Vec3::ZERO, Vec3::Z, Vec3::X, Vec3::Y];
        let (volume, mut twins_of_mesh) = (mesh.volume(), twins(&mesh));
        for half in [0, 4, 8, 3, 11] {
            split_edge(&mut mesh, &mut twins_of_mesh, half);
            assert!(mesh.is_closed());
            assert_eq!(mesh.euler_characteristic(), 2);
            assert_eq!(twins_of_mesh, twins(&mesh));
        }
        assert!((mesh.volume() - volume).abs() < 1e-12);
    }
}
