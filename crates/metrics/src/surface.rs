//! Distances between surfaces: from points spread over the one to the nearest point of the other's
//! triangles.

use field::{Field, Real, Sphere};
use glam::DVec3;
use rayon::prelude::*;

use super::tree::Tree;
use mesh::{Components, Mesh, extract_with};
use random::{mix, unit};

/// How two surfaces compare; lengths in world units.
///
/// Distances are those of a point on one surface to the nearest point *of the triangles* of the
/// other, not to a sample of them. So there is no floor that comes from sampling: equal surfaces
/// are at distance 0. What sampling leaves is noise, in `standard_error`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// (accuracy + completeness)/2: the mean of both directions of plain Euclidean distances, not
    /// squared. Often called L1 Chamfer distance; others take the sum of both directions, twice as
    /// much.
    pub chamfer: f64,
    /// Mean distance from the first surface to the second.
    pub accuracy: f64,
    /// Mean distance from the second surface to the first.
    pub completeness: f64,
    /// The harmonic mean of the shares of points within the threshold, both ways.
    pub f_score: f64,
    /// Mean |n·n′| of a point's face and the nearest face, the mean of both directions.
    pub normal_consistency: f64,
    /// The standard error of `chamfer` that comes from the finite number of points (an upper bound:
    /// points are stratified).
    pub standard_error: f64,
}

/// Compares two surfaces by `samples` points on each (at least one), uniform by area. Points within
/// `threshold` count for the F-score.
///
/// If either surface has no faces, distances are infinite and the F-score and the normal
/// consistency are 0.
pub fn compare(a: &Mesh, b: &Mesh, samples: usize, threshold: f64) -> Comparison {
    let [there, back] = [(a, b, 1), (b, a, 2)]
        .map(|(from, to, seed)| Direction::new(from, to, samples, seed, threshold));
    let (precision, recall) = (there.within, back.within);
    Comparison {
        chamfer: 0.5 * (there.distance + back.distance),
        accuracy: there.distance,
        completeness: back.distance,
        f_score: if precision + recall > 0.0 {
            2.0 * precision * recall / (precision + recall)
        } else {
            0.0
        },
        normal_consistency: 0.5 * (there.alignment + back.alignment),
        standard_error: 0.5 * (there.variance_of_mean + back.variance_of_mean).sqrt(),
    }
}

/// Compares a surface with the zero level set of an exact field within `bounds`, as a mesh of
/// `resolution` cells along the diameter, all pieces kept. The true mesh's vertices lie on the
/// level set; between them it is off by about cell²/(8 · radius of curvature).
pub fn compare_to_field<R: Real>(
    mesh: &Mesh,
    truth: &dyn Field<R>,
    bounds: &Sphere<f64>,
    resolution: usize,
    samples: usize,
    threshold: f64,
) -> Comparison {
    compare(
        mesh,
        &extract_with(truth, bounds, resolution, Components::All, &|_| {}),
        samples,
        threshold,
    )
}

/// Means over points of one surface.
struct Direction {
    distance: f64,
    variance_of_mean: f64,
    within: f64,
    alignment: f64,
}

impl Direction {
    fn new(from: &Mesh, to: &Mesh, samples: usize, seed: u64, threshold: f64) -> Self {
        let points = sample_surface(from, samples.max(1), seed);
        if points.is_empty() || to.faces.is_empty() {
            return Direction {
                distance: f64::INFINITY,
                variance_of_mean: 0.0,
                within: 0.0,
                alignment: 0.0,
            };
        }
        let tree = Tree::new(to);
        let found: Vec<(f64, f64)> = points
            .par_iter()
            .map(|p| {
                let (distance, face) = tree.nearest(p.position);
                (distance, p.normal.dot(to.face_cross(face).normalize_or_zero()).abs())
            })
            .collect();
        let count = found.len() as f64;
        let mean = |f: &dyn Fn(&(f64, f64)) -> f64| found.iter().map(f).sum::<f64>() / count;
        let distance = mean(&|p| p.0);
        Direction {
            distance,
            variance_of_mean: mean(&|p| (p.0 - distance).powi(2)) / count,
            within: mean(&|p| f64::from(u8::from(p.0 <= threshold))),
            alignment: mean(&|p| p.1),
        }
    }
}

/// A point of a surface and its face's unit normal (zero on a face without area).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Where it is, world units.
    pub position: DVec3,
    /// The normal of its face.
    pub normal: DVec3,
}

/// `count` points uniform by area, a pure function of its arguments: stratified over the running
/// sum of areas, so that faces get their share but for rounding, and in the order of faces. No
/// points for a mesh without faces.
pub fn sample_surface(mesh: &Mesh, count: usize, seed: u64) -> Vec<SurfacePoint> {
    if mesh.faces.is_empty() {
        return Vec::new();
    }
    let area = |face: usize| 0.5 * mesh.face_cross(face).length();
    let total = mesh.area();
    let (mut face, mut passed) = (0, area(0));
    (0..count as u64)
        .map(|i| {
            let [a, b, c] = [0, 1, 2].map(|k| unit(mix(seed, 3 * i + k)));
            let at = (i as f64 + a) / count as f64 * total;
            while passed < at && face + 1 < mesh.faces.len() {
                face += 1;
                passed += area(face);
            }
            let [p, q, r] = mesh.corners(face);
            // Uniform in a triangle: the root makes lines parallel to an edge as likely as they are
            // long.
            let root = b.sqrt();
            let position = p * (1.0 - root) + q * (root * (1.0 - c)) + r * (root * c);
            SurfacePoint { position, normal: mesh.face_cross(face).normalize_or_zero() }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use field::Shape;
    use glam::Vec3;
    use mesh::extract;

    const BOUNDS: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 1.2 };

    fn ball(x: f64, radius: f64) -> Mesh {
        extract(&Shape::<f64>::sphere([x, 0.0, 0.0], radius), &BOUNDS, 64, &|_| {})
    }

    fn square(z: f32) -> Mesh {
        let vertices = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
            .map(|[x, y]| Vec3::new(x, y, z))
            .to_vec();
        Mesh { vertices, normals: vec![], faces: vec![[0, 1, 2], [0, 2, 3]] }
    }

    #[test]
    fn concentric_spheres_are_as_far_apart_as_their_radii() {
        let c = compare(&ball(0.0, 0.7), &ball(0.0, 0.72), 5000, 0.01);
        assert_relative_eq!(c.chamfer, 0.02, epsilon = 4e-4);
        assert_eq!(c.f_score, 0.0);
        assert!(c.normal_consistency > 0.999, "{c:?}");
        let truth = Shape::<f64>::sphere([0.0; 3], 0.72);
        let f = compare_to_field(&ball(0.0, 0.7), &truth, &BOUNDS, 128, 5000, 0.021);
        assert_relative_eq!(f.chamfer, 0.02, epsilon = 3e-4);
        assert_eq!(f.f_score, 1.0);
    }

    #[test]
    fn a_moved_sphere_is_half_its_way_off() {
        // A point of the sphere is cos φ · d from the moved one, to first order in d: on average
        // d/2.
        let c = compare(&ball(0.0, 0.7), &ball(0.02, 0.7), 20_000, 0.01);
        assert_relative_eq!(c.chamfer, 0.01, max_relative = 0.02);
        assert_relative_eq!(c.f_score, 0.5, epsilon = 0.02);
        assert!(c.standard_error > 1e-6 && c.standard_error < 1e-4, "{c:?}");
    }

    #[test]
    fn a_surface_is_at_distance_zero_from_itself() {
        let mesh = ball(0.1, 0.7);
        let c = compare(&mesh, &mesh, 2000, 1e-6);
        assert!(c.chamfer < 1e-12 && c.f_score == 1.0 && c.normal_consistency > 0.999, "{c:?}");
    }

    #[test]
    fn directions_are_told_apart() {
        let (mut both, one) = (square(0.0), square(0.0));
        let far = square(3.0);
        both.faces.extend(far.faces.iter().map(|f| f.map(|v| v + 4)));
        both.vertices.extend(&far.vertices);
        let c = compare(&both, &one, 1000, 0.1);
        assert_eq!((c.accuracy, c.completeness, c.chamfer), (1.5, 0.0, 0.75));
        assert_relative_eq!(c.f_score, 2.0 * 0.5 / 1.5, epsilon = 1e-12);
        assert_eq!(c.normal_consistency, 1.0);
    }

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

    #[test]
    fn nothing_compares_with_nothing() {
        let c = compare(&Mesh::default(), &square(0.0), 10, 0.1);
        assert_eq!((c.chamfer, c.f_score, c.normal_consistency), (f64::INFINITY, 0.0, 0.0));
        let flat = Mesh { vertices: vec![Vec3::ZERO; 3], normals: vec![], faces: vec![[0, 1, 2]] };
        assert_eq!(compare(&flat, &square(0.0), 10, 0.1).accuracy, 0.0);
        assert!(compare(&square(0.0), &square(0.0), 0, 0.1).chamfer < 1e-12);
    }
}
