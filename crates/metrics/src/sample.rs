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
            let normal = mesh.face_cross(face).normalize_or_zero();
            SurfacePoint { position: point_in_triangle(mesh.corners(face), b, c), normal }
        })
        .collect()
}

/// A uniform point of a triangle from two uniform numbers in [0, 1).
///
/// (1 − √b) p + √b (1 − c) q + √b c r: Osada, Funkhouser, Chazelle, Dobkin, "Shape Distributions",
/// ACM Transactions on Graphics 2002. The root makes each line parallel to the edge q r as likely
/// as it is long.
fn point_in_triangle([p, q, r]: [DVec3; 3], b: f64, c: f64) -> DVec3 {
    let root = b.sqrt();
    p * (1.0 - root) + q * (root * (1.0 - c)) + r * (root * c)
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
