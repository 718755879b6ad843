//! The part of a surface that cameras see.

use std::ops::Range;

use dataset::View;
use glam::{DVec2, DVec3};
use mesh::Mesh;
use metrics::SurfacePoint;
use rayon::prelude::*;
use render::{Camera, InvalidField, Sample, Scene};

/// Rays that one task traces: enough to fill the field's blocks of points.
const CHUNK: usize = 2048;

/// Marks the points that a camera of the scene sees. Points that are marked already cost nothing.
///
/// A point is seen if its normal points to the side of the camera, its projection is on the film,
/// `is_used` holds for the pixel there (row-major), and the ray to it has no hit further than
/// `tolerance` (world units) before it. A ray without a hit passes beside the point, by an error of
/// its position.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
///
/// # Panics
/// If the scene has no camera of this number.
pub fn mark_seen(
    scene: &Scene<'_, f32>,
    camera: usize,
    is_used: &(dyn Fn(usize) -> bool + Sync),
    points: &[SurfacePoint],
    tolerance: f64,
    seen: &mut [bool],
) -> Result<(), InvalidField> {
    let view = &scene.cameras[camera];
    let candidates: Vec<(usize, Sample)> = (0..points.len())
        .filter(|i| !seen[*i] && points[*i].normal.dot(view.eye - points[*i].position) > 0.0)
        .filter_map(|i| {
            let (u, pixel) = pixel_of(view, points[i].position)?;
            is_used(pixel).then_some((i, Sample { camera, u }))
        })
        .collect();
    let is_free = |chunk: &[(usize, Sample)]| -> Result<Vec<bool>, InvalidField> {
        let samples: Vec<Sample> = chunk.iter().map(|(_, sample)| *sample).collect();
        let traced = scene.trace(&samples)?;
        let is_free = |((i, _), ray): (&(usize, Sample), Option<render::TracedRay<f32>>)| {
            let distance = (points[*i].position - view.eye).length();
            let depth = ray.and_then(|ray| ray.depth()).map(f64::from);
            depth.is_none_or(|depth| depth > distance - tolerance)
        };
        Ok(chunk.iter().zip(traced).map(is_free).collect())
    };
    let found: Vec<_> = candidates.par_chunks(CHUNK).map(is_free).collect();
    for (chunk, found) in candidates.chunks(CHUNK).zip(found) {
        for ((i, _), is_free) in chunk.iter().zip(found?) {
            seen[*i] = is_free;
        }
    }
    Ok(())
}

/// For each of the points, whether one of the views sees it: see [`mark_seen`]. A pixel that a mask
/// leaves out sees nothing.
///
/// `cameras` are the numbers of the views in the scene. `progress` gets the fraction that is done.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
///
/// # Panics
/// If the scene has fewer cameras.
pub fn seen_vertices(
    scene: &Scene<'_, f32>,
    cameras: Range<usize>,
    views: &[View],
    points: &[SurfacePoint],
    tolerance: f64,
    progress: &dyn Fn(f64),
) -> Result<Vec<bool>, InvalidField> {
    let mut seen = vec![false; points.len()];
    for (done, (camera, view)) in cameras.zip(views).enumerate() {
        let is_used = |pixel: usize| view.is_used(pixel);
        mark_seen(scene, camera, &is_used, points, tolerance, &mut seen)?;
        progress((done + 1) as f64 / views.len() as f64);
    }
    Ok(seen)
}

/// The vertices of a mesh, relative to its origin, with unit normals: its own, or else the mean of
/// the faces' normals by area (zero at a vertex without faces).
pub fn vertices_with_normals(mesh: &Mesh) -> Vec<SurfacePoint> {
    let mut normals: Vec<DVec3> = mesh.normals.iter().map(|n| n.as_dvec3()).collect();
    if normals.len() != mesh.vertices.len() {
        normals = vec![DVec3::ZERO; mesh.vertices.len()];
        for (i, face) in mesh.faces.iter().enumerate() {
            let cross = mesh.face_cross(i);
            face.iter().for_each(|v| normals[*v as usize] += cross);
        }
    }
    let point = |(v, n): (&glam::Vec3, &DVec3)| SurfacePoint {
        position: v.as_dvec3(),
        normal: n.normalize_or_zero(),
    };
    mesh.vertices.iter().zip(&normals).map(point).collect()
}

/// The film position of a point and the number of its pixel, row-major; `None` outside the film.
pub(crate) fn pixel_of(camera: &Camera, x: DVec3) -> Option<(DVec2, usize)> {
    let u = camera.project_onto_film(x)?;
    Some((u, u.y as usize * camera.width as usize + u.x as usize))
}
