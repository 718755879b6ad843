//! Vertices at one place, moved apart.
//!
//! A reader that merges equal positions, as that of every STL file does, joins sheets of a surface
//! that only touch. It then finds edges with four faces. Such places come from sheets that were
//! separated in a cell, and from vertices that the projection moved to one point.

use glam::DVec3;
use rayon::prelude::*;

use crate::Mesh;

/// The least distance of two vertices, in cells: far less than the error of the mesh.
const LEAST_DISTANCE: f64 = 1e-3;

/// The least distance of two vertices, in units in the last place of the largest coordinate.
/// Positions then stay apart when they are scaled and rounded.
const LEAST_UNITS: f64 = 16.0;

/// A unit in the last place of 1 in single precision.
const UNIT: f64 = f32::EPSILON as f64;

/// Rounds of moves. One or two are enough but for vertices that cannot be told apart otherwise.
const ROUNDS: usize = 64;

/// Groups of more vertices are moved as a whole: no comparison of all pairs.
const LARGEST_GROUP: usize = 64;

/// The share of a direction of its own in each vertex's move.
const OWN_SHARE: f64 = 0.25;

/// Moves vertices apart until no two are closer than 1/1000 of a cell along every axis.
///
/// A vertex moves towards the middle of its neighbours, so that it stays on its own sheet. The
/// faces do not change.
pub(crate) fn separate(mesh: &mut Mesh, cell: f64) {
    let largest = mesh.vertices.iter().fold(0.0f32, |m, v| m.max(v.abs().max_element()));
    let distance = (LEAST_DISTANCE * cell).max(LEAST_UNITS * UNIT * f64::from(largest));
    if !(distance > 0.0 && distance.is_finite()) {
        return;
    }
    for round in 0..ROUNDS {
        let crowded = crowded(mesh, distance);
        if crowded.is_empty() {
            return;
        }
        let towards = towards_neighbours(mesh, &crowded);
        for ((v, rank), towards) in crowded.iter().zip(towards) {
            let own = own_direction(*v as usize + round);
            let direction = (towards.normalize_or_zero() + OWN_SHARE * own).normalize_or(own);
            let length = distance * (2.0 + f64::from(*rank)) * (1.0 + round as f64);
            let vertex = &mut mesh.vertices[*v as usize];
            *vertex = (vertex.as_dvec3() + direction * length).as_vec3();
        }
    }
}

/// The vertices that are closer than `distance` to another one, in order, each with its place in
/// its group.
///
/// Two such vertices share a cube of at least one of eight lattices with sides of 2 · `distance`,
/// which are shifted by half a side along the axes.
fn crowded(mesh: &Mesh, distance: f64) -> Vec<(u32, u32)> {
    let mut found = Vec::new();
    for shift in 0..8u32 {
        let shift = DVec3::from([0, 1, 2].map(|axis| 0.5 * f64::from(shift >> axis & 1)));
        let cube = |(i, v): (usize, &glam::Vec3)| {
            let at = (v.as_dvec3() / (2.0 * distance) + shift).floor();
            (at.to_array().map(|c| c as i32), i as u32)
        };
        let mut cubes: Vec<([i32; 3], u32)> =
            mesh.vertices.par_iter().enumerate().map(cube).collect();
        cubes.par_sort_unstable();
        for group in cubes.chunk_by(|a, b| a.0 == b.0).filter(|group| group.len() > 1) {
            let members = group.iter().map(|(_, v)| *v).enumerate();
            let near = members.filter(|(_, v)| is_near_another(mesh, *v, group, distance));
            found.extend(near.map(|(rank, v)| (v, rank as u32)));
        }
    }
    found.sort_unstable();
    found.dedup_by_key(|(v, _)| *v);
    found
}

/// Whether vertex `v` is closer than `distance` to another one of the group, along every axis.
fn is_near_another(mesh: &Mesh, v: u32, group: &[([i32; 3], u32)], distance: f64) -> bool {
    let position = |v: u32| mesh.vertices[v as usize].as_dvec3();
    group.len() > LARGEST_GROUP
        || group.iter().any(|(_, other)| {
            *other != v && (position(v) - position(*other)).abs().max_element() < distance
        })
}

/// For each of these vertices the sum of the vectors to its neighbours.
fn towards_neighbours(mesh: &Mesh, vertices: &[(u32, u32)]) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; vertices.len()];
    let position = |v: u32| mesh.vertices[v as usize].as_dvec3();
    for face in &mesh.faces {
        for k in 0..3 {
            let v = face[k];
            if let Ok(at) = vertices.binary_search_by_key(&v, |(v, _)| *v) {
                let others = [face[(k + 1) % 3], face[(k + 2) % 3]];
                sums[at] += others.iter().map(|o| position(*o) - position(v)).sum::<DVec3>();
            }
        }
    }
    sums
}

/// A unit vector for each number: points spread evenly over the sphere along a spiral whose turns
/// differ by the golden ratio.
fn own_direction(number: usize) -> DVec3 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let share = |factor: f64| (number as f64 * factor).fract();
    let z = 1.0 - 2.0 * share(GOLDEN);
    let (s, c) = (std::f64::consts::TAU * share(GOLDEN * GOLDEN * 0.5 + 0.1)).sin_cos();
    let across = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(across * c, across * s, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn vertices_at_one_place_are_moved_apart_and_others_stay() {
        let mut mesh = Mesh { vertices: vec![Vec3::ONE; 200], ..Mesh::default() };
        mesh.vertices.extend([Vec3::X, Vec3::Y]);
        separate(&mut mesh, 1e-2);
        assert!(crowded(&mesh, 1e-5).is_empty());
        assert_eq!(mesh.vertices[200..], [Vec3::X, Vec3::Y]);
        assert!(mesh.vertices[..200].iter().all(|v| (*v - Vec3::ONE).length() < 0.5));
    }

    /// Positions on both sides of a cube's side are found.
    #[test]
    fn near_vertices_are_found_wherever_the_lattice_lies() {
        for i in 0..64 {
            let at = Vec3::splat(0.1 + i as f32 * 1.7e-4);
            let near = at + Vec3::new(8e-4, -8e-4, 8e-4);
            let mesh = Mesh { vertices: vec![at, near], ..Mesh::default() };
            assert_eq!(crowded(&mesh, 1e-3).len(), 2, "{at}");
            assert!(crowded(&mesh, 7e-4).is_empty(), "{at}");
        }
    }
}
