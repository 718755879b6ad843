//! The surface of a fit: its part on the bounding sphere, and its part that no photograph sees.

use std::ops::Range;

use export::cut::{Ground, ground, mark_seen};
use field::Sphere;
use glam::DVec3;
use mesh::extract;
use metrics::{SurfacePoint, sample_surface};
use render::upwards;
use render::{InvalidField, Scene};
use serde::Serialize;

/// Shares of a surface's area, each 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SurfaceShares {
    /// On the bounding sphere.
    pub on_sphere: f64,
    /// On the bounding sphere, and seen by a photograph.
    pub seen_on_sphere: f64,
    /// Like `seen_on_sphere`, and not on the table or below it, if there is one.
    pub seen_above_table: f64,
    /// Seen by no photograph: behind other parts of the surface, from behind, or off all films.
    pub unseen: f64,
    /// Seen by no photograph, of the part that a capture of a thing on a table could show: it does
    /// not face down, and lies neither below the table nor on the bounding sphere.
    pub unseen_sides: f64,
}

/// Grid cells of the mesh along the diameter of the bounding sphere.
const CELLS: usize = 96;

/// Points on the surface. The standard deviation of a share is at most 1.1 %.
const SURFACE_POINTS: usize = 2000;

/// A point is on the bounding sphere if it is this close, in bounding radii: one and a half cells
/// of the mesh. Solids that leave the sphere are cut off there.
const ON_SPHERE: f64 = 0.03;

/// The cosine between a normal and the upward direction below which a point faces down: by 30
/// degrees.
const DOWN: f64 = -0.5;

/// A point is visible if the hit of its ray lies at most this far in front of it, in bounding
/// radii: the width of a cell, which is more than the error of the mesh.
const SAME_POINT: f64 = 2.0 / CELLS as f64;

/// Counts the shares on about 2000 points of a mesh. `sphere` is the bounding sphere, and
/// `cameras` are the numbers of the photographs' cameras in `scene`. `None` without a surface.
///
/// # Errors
/// If the field gives a NaN or an infinity along a ray.
pub fn surface_shares(
    scene: &Scene<'_, f32>,
    sphere: &Sphere<f64>,
    cameras: Range<usize>,
) -> Result<Option<SurfaceShares>, InvalidField> {
    let mesh = extract(scene.field, sphere, CELLS, &|_| {});
    let points = sample_surface(&mesh, SURFACE_POINTS, 0);
    if points.is_empty() {
        return Ok(None);
    }
    let mut seen = vec![false; points.len()];
    for camera in cameras.clone() {
        mark_seen(scene, camera, &|_| true, &points, SAME_POINT * sphere.radius, &mut seen)?;
    }
    let on_sphere = |p: &SurfacePoint| {
        (p.position - sphere.center).length() > (1.0 - ON_SPHERE) * sphere.radius
    };
    let table = table(scene, sphere, cameras.clone(), &points, &seen);
    let is_above = |p: &SurfacePoint| {
        table.as_ref().is_none_or(|t| t.plane.height(p.position) > ON_SPHERE * sphere.radius)
    };
    let share = |holds: &dyn Fn(&SurfacePoint, bool) -> bool| {
        let count = points.iter().zip(&seen).filter(|(p, seen)| holds(p, **seen)).count();
        count as f64 / points.len() as f64
    };
    let up = upwards(&scene.cameras[cameras], sphere.center);
    let is_side = |p: &SurfacePoint| p.normal.dot(up) > DOWN && is_above(p) && !on_sphere(p);
    let sides = share(&|p, _| is_side(p)).max(f64::MIN_POSITIVE);
    Ok(Some(SurfaceShares {
        on_sphere: share(&|p, _| on_sphere(p)),
        seen_on_sphere: share(&|p, seen| seen && on_sphere(p)),
        seen_above_table: share(&|p, seen| seen && on_sphere(p) && is_above(p)),
        unseen: share(&|_, seen| !seen),
        unseen_sides: share(&|p, seen| !seen && is_side(p)) / sides,
    }))
}

/// The table in the seen part of a surface, of which each point stands for the same area.
fn table(
    scene: &Scene<'_, f32>,
    sphere: &Sphere<f64>,
    cameras: Range<usize>,
    points: &[SurfacePoint],
    seen: &[bool],
) -> Option<Ground> {
    let cameras = &scene.cameras[cameras];
    let eyes: Vec<DVec3> = cameras.iter().map(|camera| camera.eye).collect();
    let seen: Vec<SurfacePoint> =
        points.iter().zip(seen).filter(|(_, seen)| **seen).map(|(point, _)| *point).collect();
    let (areas, up) = (vec![1.0; seen.len()], upwards(cameras, sphere.center));
    ground(&seen, &areas, &eyes, up, sphere.radius)
}

#[cfg(test)]
#[path = "surface_tests.rs"]
mod tests;
