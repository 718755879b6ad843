//! Points on a mesh, uniform by area.

use glam::DVec3;
use mesh::Mesh;
use random::{Name, Stream};

const SURFACE_POINTS: Name = Name::new("points on a mesh", 21);

/// A point of a surface, with the unit normal of its face (zero if the face has no area).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The position, world units.
    pub position: DVec3,
    /// The unit normal of the face.
    pub normal: DVec3,
}

/// `count` random points on a mesh, uniform by area, in the order of its faces.
///
/// The points are stratified: the total area is divided into `count` equal intervals along the
/// running sum of the faces' areas, with one point each. So the number of points on a face differs
/// by less than 2 from `count` times its share of the area. The result is a pure function of the
/// arguments. It is empty for a mesh without faces.
pub fn sample_surface(mesh: &Mesh, count: usize, seed: u64) -> Vec<SurfacePoint> {
    let point = |place: Place| {
        let normal = mesh.face_cross(place.face).normalize_or_zero();
        SurfacePoint { position: place.position(mesh), normal }
    };
    sample_places(mesh, count, seed).into_iter().map(point).collect()
}

/// A place on a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    pub(crate) face: usize,
    /// The weights of the corners of the face: 0 or more, with the sum 1.
    pub(crate) weights: [f64; 3],
}

impl Place {
    /// The position, world units.
    pub(crate) fn position(&self, mesh: &Mesh) -> DVec3 {
        let corners = mesh.corners(self.face);
        (0..3).map(|k| corners[k] * self.weights[k]).sum()
    }
}

/// The places of the points of [`sample_surface`].
pub(crate) fn sample_places(mesh: &Mesh, count: usize, seed: u64) -> Vec<Place> {
    if mesh.faces.is_empty() {
        return Vec::new();
    }
    let face_area = |face: usize| 0.5 * mesh.face_cross(face).length();
    let total = mesh.area();
    let (mut face, mut area_up_to_face) = (0, face_area(0));
    let stream = Stream::of_seed(seed).named(SURFACE_POINTS);
    (0..count as u64)
        .map(|i| {
            let [a, b, c] = [0, 1, 2].map(|k| stream.at(i).at(k).unit());
            let area = (i as f64 + a) / count as f64 * total;
            while area_up_to_face < area && face + 1 < mesh.faces.len() {
                face += 1;
                area_up_to_face += face_area(face);
            }
            Place { face, weights: weights_in_triangle(b, c) }
        })
        .collect()
}

/// The weights of a uniform point of a triangle from two uniform numbers in [0, 1).
///
/// 1 − √b, √b (1 − c) and √b c: Osada, Funkhouser, Chazelle, Dobkin, "Shape Distributions",
/// ACM Transactions on Graphics 2002. The root makes each line parallel to the edge q r as likely
/// as it is long.
fn weights_in_triangle(b: f64, c: f64) -> [f64; 3] {
    let root = b.sqrt();
    [1.0 - root, root * (1.0 - c), root * c]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::square;

    #[test]
    fn points_are_uniform_and_depend_on_the_seed_alone() {
        let mesh = square(0.0);
        let points = sample_surface(&mesh, 4000, 7);
        assert_eq!(points, sample_surface(&mesh, 4000, 7));
        assert_ne!(points, sample_surface(&mesh, 4000, 8));
        let mean = points.iter().map(|p| p.position).sum::<DVec3>() / 4000.0;
        assert!((mean - DVec3::new(0.5, 0.5, 0.0)).length() < 0.02, "{mean}");
        for quarter in 0..4 {
            let inside = |p: &&SurfacePoint| {
                (p.position.x >= 0.5) as i32 + 2 * (p.position.y >= 0.5) as i32 == quarter
            };
            let share = points.iter().filter(inside).count() as f64 / 4000.0;
            assert!((share - 0.25).abs() < 0.03, "{share}");
        }
    }
}
