//! Projection of vertices onto the surface, and the normals of the surface there.

use field::Real;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::Mesh;
use crate::solid::Solid;

/// Newton steps for each vertex. The grid's interpolation leaves an error of about a tenth of a
/// cell, and each step squares it.
const NEWTON_STEPS: usize = 4;

/// The farthest that a vertex may move from its position on the grid, in cells.
const LARGEST_MOVE: f64 = 0.5;

/// A shorter step ends the iteration, in cells. Single precision does not resolve it on most grids.
const LEAST_STEP: f64 = 1e-5;

/// Moves vertices onto {F = 0} along ∇F, by half a `cell` at most, and sets the unit normals.
///
/// Each vertex ends at the visited position with the smallest |F|. The normal is the direction of
/// ∇F there.
pub(crate) fn onto<R: Real>(solid: &Solid<R>, cell: f64, mesh: &mut Mesh) {
    /// Vertices that a thread projects at once.
    const CHUNK: usize = 2048;
    mesh.normals = vec![Vec3::ZERO; mesh.vertices.len()];
    let chunks = mesh.vertices.par_chunks_mut(CHUNK).zip(mesh.normals.par_chunks_mut(CHUNK));
    chunks.for_each(|(vertices, normals)| project(solid, cell, vertices, normals));
    replace_missing_normals(mesh);
}

fn project<R: Real>(solid: &Solid<R>, cell: f64, vertices: &mut [Vec3], normals: &mut [Vec3]) {
    let start: Vec<DVec3> = vertices.iter().map(|v| v.as_dvec3()).collect();
    let mut least = vec![f64::INFINITY; start.len()];
    // Vertices that still move, and their positions.
    let mut active: Vec<usize> = (0..start.len()).collect();
    let mut x = start.clone();
    for _ in 0..=NEWTON_STEPS {
        let (mut next_active, mut next_x) = (Vec::new(), Vec::new());
        for (k, (f, gradient)) in solid.value_gradient(&x).into_iter().enumerate() {
            let i = active[k];
            if f.abs() < least[i] {
                (least[i], vertices[i]) = (f.abs(), x[k].as_vec3());
                normals[i] = gradient.normalize_or_zero().as_vec3();
            }
            let step = gradient * (f / gradient.length_squared());
            if step.is_finite() && step.length() > LEAST_STEP * cell {
                let displacement = x[k] - step - start[i];
                next_active.push(i);
                next_x.push(start[i] + displacement.clamp_length_max(LARGEST_MOVE * cell));
            }
        }
        (active, x) = (next_active, next_x);
        if active.is_empty() {
            break;
        }
    }
}

/// Replaces normals where ∇F is zero or not finite by the mean of the adjacent faces' normals,
/// weighted by area.
fn replace_missing_normals(mesh: &mut Mesh) {
    let missing: Vec<bool> = mesh.normals.iter().map(|n| !n.is_normalized()).collect();
    if !missing.contains(&true) {
        return;
    }
    let mut sums = vec![DVec3::ZERO; mesh.vertices.len()];
    for (i, face) in mesh.faces.iter().enumerate() {
        face.iter().for_each(|v| sums[*v as usize] += mesh.face_cross(i));
    }
    for (i, _) in missing.iter().enumerate().filter(|(_, m)| **m) {
        mesh.normals[i] = sums[i].normalize_or(DVec3::Z).as_vec3();
    }
}
