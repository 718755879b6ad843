//! From a surface that touches itself to a manifold.
//!
//! Surface nets put one vertex in a cell, also where two sheets of the surface pass through it.
//! There the sheets share a vertex, or an edge with four faces. Every edge is still passed as often
//! one way as the other, and so the faces at an edge can be paired. The pairs say which corners are
//! one vertex (they are neighbours around it), and each such class gets a vertex of its own:
//! "cutting" in Guéziec et al., Cutting and Stitching, 2001.

use glam::DVec3;

use super::Mesh;
use super::components::Sets;
use super::edges::{self, Edge};

/// No half-edge.
const NONE: u32 = u32::MAX;

/// Makes each edge that is passed equally often both ways simple, and the faces around each vertex
/// one fan. The surface as a set of points stays as it is. Normals are not carried along.
pub(super) fn make_manifold(mesh: &mut Mesh) {
    let mut mates = mates(mesh);
    split_vertices(mesh, &mates);
    while split_double_edges(mesh, &mut mates) {}
}

/// The half-edge that runs opposite to each half-edge, in the neighbour across it.
fn mates(mesh: &Mesh) -> Vec<u32> {
    let mut mates = vec![NONE; 3 * mesh.faces.len()];
    for edge in edges::sorted(mesh).chunk_by(edges::same) {
        if edges::is_simple(mesh, edge) {
            join(&mut mates, edge[0].1, edge[1].1);
        } else {
            pair_by_angle(mesh, edge, &mut mates);
        }
    }
    mates
}

fn join(mates: &mut [u32], a: u32, b: u32) {
    (mates[a as usize], mates[b as usize]) = (b, a);
}

/// Pairs the faces around one edge that bound the same wedge of the solid: the solid's parts are
/// separated there.
fn pair_by_angle(mesh: &Mesh, edge: &[Edge], mates: &mut [u32]) {
    let [low, high] = edge[0].0.map(|v| mesh.vertices[v as usize].as_dvec3());
    let axis = (high - low).try_normalize().unwrap_or(DVec3::X);
    let (u, v) = axis.any_orthonormal_pair();
    let mut around: Vec<(f64, u32)> =
        edge.iter().map(|(_, half)| (angle(mesh, *half, low, u, v), *half)).collect();
    around.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    // With the solid on its far side begins the face that runs from high to low; the next one the
    // other way ends it.
    let begins = |half: u32| edges::ends(mesh, half)[0] == edge[0].0[1];
    let mut open = Vec::new();
    for turn in 0..2 {
        for (_, half) in &around {
            if turn == 0 && begins(*half) {
                open.push(*half);
            } else if !begins(*half)
                && mates[*half as usize] == NONE
                && let Some(start) = open.pop()
            {
                join(mates, start, *half);
            }
        }
    }
}

/// The angle about an edge at which the face of a half-edge lies; `u`, `v` and the edge are
/// right-handed.
fn angle(mesh: &Mesh, half: u32, origin: DVec3, u: DVec3, v: DVec3) -> f64 {
    let face = mesh.faces[half as usize / 3];
    let opposite = mesh.vertices[face[(half as usize + 2) % 3] as usize].as_dvec3() - origin;
    opposite.dot(v).atan2(opposite.dot(u))
}

/// Gives each class of corners its own vertex; the first class keeps the old one.
fn split_vertices(mesh: &mut Mesh, mates: &[u32]) {
    let next = |half: u32| half - half % 3 + (half + 1) % 3;
    let mut sets = Sets::new(mates.len());
    for (half, mate) in mates.iter().enumerate().filter(|(_, m)| **m != NONE) {
        sets.join(half as u32, next(*mate));
    }
    let mut keeper = vec![NONE; mesh.vertices.len()];
    let mut vertex = vec![NONE; mates.len()];
    for corner in 0..mates.len() as u32 {
        let root = sets.root(corner) as usize;
        let old = mesh.faces[corner as usize / 3][corner as usize % 3];
        if vertex[root] == NONE {
            vertex[root] = old;
            if keeper[old as usize] == NONE {
                keeper[old as usize] = corner;
            } else {
                vertex[root] = mesh.vertices.len() as u32;
                mesh.vertices.push(mesh.vertices[old as usize]);
            }
        }
        mesh.faces[corner as usize / 3][corner as usize % 3] = vertex[root];
    }
}

/// Two pairs of faces may still share both ends of an edge: all pairs but one get a vertex in its
/// middle. One round, in which each face changes once at most; false if there was nothing to do.
fn split_double_edges(mesh: &mut Mesh, mates: &mut Vec<u32>) -> bool {
    let edges = edges::sorted(mesh);
    let doubled = edges.chunk_by(edges::same).filter(|e| e.len() > 2);
    let first_of_pair = |e: &&Edge| mates[e.1 as usize] != NONE && e.1 < mates[e.1 as usize];
    let excess: Vec<u32> =
        doubled.flat_map(|e| e.iter().filter(first_of_pair).skip(1)).map(|e| e.1).collect();
    let mut changed = vec![false; mesh.faces.len()];
    for half in &excess {
        let faces = [*half, mates[*half as usize]].map(|h| h as usize / 3);
        if faces.iter().all(|f| !changed[*f]) {
            faces.iter().for_each(|f| changed[*f] = true);
            split_edge(mesh, mates, *half);
        }
    }
    !excess.is_empty()
}

/// Splits the edge of a half-edge and its mate in the middle, and with it both faces.
fn split_edge(mesh: &mut Mesh, mates: &mut Vec<u32>, half: u32) {
    let [a, b] = edges::ends(mesh, half);
    let middle = mesh.vertices.len() as u32;
    mesh.vertices.push(mesh.vertices[a as usize].midpoint(mesh.vertices[b as usize]));
    let old = [half, mates[half as usize]];
    // Each face (a, b, c) becomes (a, middle, c), in its place, and (middle, b, c).
    let new = old.map(|h| {
        let (face, k) = (h as usize / 3, h as usize % 3);
        let [end, far] = [1, 2].map(|i| mesh.faces[face][(k + i) % 3]);
        mesh.faces[face][(k + 1) % 3] = middle;
        let added = 3 * mesh.faces.len() as u32;
        mesh.faces.push([middle, end, far]);
        mates.extend([NONE; 3]);
        let side = (3 * face + (k + 1) % 3) as u32;
        let across = mates[side as usize];
        if across != NONE {
            join(mates, added + 1, across);
        }
        join(mates, side, added + 2);
        added
    });
    join(mates, old[0], new[1]);
    join(mates, old[1], new[0]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Two tetrahedra on one edge: it has four faces, and its ends two fans.
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
        let (volume, mut pairs) = (mesh.volume(), mates(&mesh));
        for half in [0, 4, 8, 3, 11] {
            split_edge(&mut mesh, &mut pairs, half);
            assert!(mesh.is_closed());
            assert_eq!((mesh.euler_characteristic(), pairs.clone()), (2, mates(&mesh)));
        }
        assert!((mesh.volume() - volume).abs() < 1e-12);
    }
}
