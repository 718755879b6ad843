//! Vertices onto the surface, and its normals.

use field::Real;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::Mesh;
use super::grid::Solid;

/// Newton steps that bring vertices from the grid's interpolation onto the surface: an error of a
/// tenth of a cell is squared in each.
const STEPS: usize = 4;

/// How far a vertex may move from where the grid put it, in cells.
const LEASH: f64 = 0.5;

/// The step that is too short to take, in cells; below what single precision resolves on most
/// grids.
const TOLERANCE: f64 = 1e-5;

/// Moves vertices onto {F = 0}, along ∇F and at most half a cell, and gives them its unit normals.
/// Of the places a vertex has been at, it stays at the one of least |F|.
pub(super) fn onto<R: Real>(solid: &Solid<R>, cell: f64, mesh: &mut Mesh) {
    const CHUNK: usize = 2048;
    mesh.normals = vec![Vec3::ZERO; mesh.vertices.len()];
    let chunks = mesh.vertices.par_chunks_mut(CHUNK).zip(mesh.normals.par_chunks_mut(CHUNK));
    chunks.for_each(|(vertices, normals)| project(solid, cell, vertices, normals));
    replace_missing_normals(mesh);
}

fn project<R: Real>(solid: &Solid<R>, cell: f64, vertices: &mut [Vec3], normals: &mut [Vec3]) {
    let start: Vec<DVec3> = vertices.iter().map(|v| v.as_dvec3()).collect();
    let mut least = vec![f64::INFINITY; start.len()];
    let mut active: Vec<usize> = (0..start.len()).collect();
    let mut x = start.clone();
    for _ in 0..=STEPS {
        let (mut still, mut next) = (Vec::new(), Vec::new());
        for (k, (f, gradient)) in solid.value_gradient(&x).into_iter().enumerate() {
            let i = active[k];
            if f.abs() < least[i] {
                (least[i], vertices[i]) = (f.abs(), x[k].as_vec3());
                normals[i] = gradient.normalize_or_zero().as_vec3();
            }
            let step = gradient * (f / gradient.length_squared());
            if step.is_finite() && step.length() > TOLERANCE * cell {
                still.push(i);
                next.push(start[i] + (x[k] - step - start[i]).clamp_length_max(LEASH * cell));
            }
        }
        (active, x) = (still, next);
        if active.is_empty() {
            break;
        }
    }
}

/// Where ∇F is zero or no number, the normal is that of the faces around, weighted by their areas.
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
