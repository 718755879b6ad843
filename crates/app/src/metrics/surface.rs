//! Distances between surfaces: from points spread over the one to the nearest point of the other's triangles.

use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use crate::mesh::Mesh;
use crate::sampler::{mix, unit};

/// How two surfaces compare; lengths in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// The mean of accuracy and completeness (plain Euclidean distances, not squared).
    pub chamfer: f64,
    /// Mean distance from the first surface to the second.
    pub accuracy: f64,
    /// Mean distance from the second surface to the first.
    pub completeness: f64,
    /// The harmonic mean of the shares of points within the threshold, both ways.
    pub f_score: f64,
    /// Mean |n·n′| of a point's face and the nearest face, both ways.
    pub normal_consistency: f64,
}

/// Compares two surfaces by `samples` points on each, uniform by area; the distance to the other surface is exact, so
/// that equal surfaces are at distance 0.
pub fn compare(a: &Mesh, b: &Mesh, samples: usize, threshold: f64) -> Comparison {
    let (to_b, to_a) = (one_way(a, b, samples, 1), one_way(b, a, samples, 2));
    let mean = |v: &[(f64, f64)], f: &dyn Fn(&(f64, f64)) -> f64| v.iter().map(f).sum::<f64>() / v.len().max(1) as f64;
    let within = |p: &(f64, f64)| f64::from(u8::from(p.0 <= threshold));
    let (precision, recall) = (mean(&to_b, &within), mean(&to_a, &within));
    let (accuracy, completeness) = (mean(&to_b, &|p| p.0), mean(&to_a, &|p| p.0));
    Comparison {
        chamfer: 0.5 * (accuracy + completeness),
        accuracy,
        completeness,
        f_score: if precision + recall > 0.0 { 2.0 * precision * recall / (precision + recall) } else { 0.0 },
        normal_consistency: 0.5 * (mean(&to_b, &|p| p.1) + mean(&to_a, &|p| p.1)),
    }
}

/// Distance to `to`, and |n·n′|, from points spread over `from`.
fn one_way(from: &Mesh, to: &Mesh, samples: usize, seed: u64) -> Vec<(f64, f64)> {
    let surface = Surface::new(to);
    spread(from, samples, seed)
        .par_iter()
        .map(|(x, normal)| {
            let (distance, face) = surface.nearest(*x);
            let other = to.face_cross(face).normalize_or_zero();
            (distance, normal.dot(other).abs())
        })
        .collect()
}

/// Points uniform by area, with their faces' unit normals: stratified over the running sum of areas.
fn spread(mesh: &Mesh, samples: usize, seed: u64) -> Vec<(DVec3, DVec3)> {
    let total = mesh.area();
    let (mut face, mut passed) = (0, 0.5 * mesh.face_cross(0).length());
    (0..samples)
        .map(|i| {
            let [a, b, c] = [0, 1, 2].map(|k| unit(mix(seed, 3 * i as u64 + k)));
            let at = (i as f64 + a) / samples as f64 * total;
            while passed < at && face + 1 < mesh.faces.len() {
                face += 1;
                passed += 0.5 * mesh.face_cross(face).length();
            }
            let [p, q, r] = mesh.corners(face);
            let root = b.sqrt();
            (p * (1.0 - root) + q * (root * (1.0 - c)) + r * (root * c), mesh.face_cross(face).normalize_or_zero())
        })
        .collect()
}

/// A mesh with its faces' centroids in a tree.
struct Surface<'a> {
    mesh: &'a Mesh,
    /// Nothing if no tree could be made (equal centroids by the hundred): then all faces are looked at.
    tree: Option<ImmutableKdTree<f64, 3>>,
    /// The farthest that a corner is from its face's centroid.
    reach: f64,
}

impl<'a> Surface<'a> {
    fn new(mesh: &'a Mesh) -> Self {
        let centroid = |i: usize| mesh.corners(i).iter().sum::<DVec3>() / 3.0;
        let centroids: Vec<[f64; 3]> = (0..mesh.faces.len()).map(|i| centroid(i).to_array()).collect();
        let reach =
            (0..mesh.faces.len()).flat_map(|i| mesh.corners(i).map(|c| (c - centroid(i)).length())).fold(0.0, f64::max);
        Surface { mesh, tree: ImmutableKdTree::new_from_slice(&centroids).ok(), reach }
    }

    /// The distance to the nearest point of the surface, and its face. Exact: a nearer face would have its centroid within
    /// the best distance so far plus the reach.
    fn nearest(&self, x: DVec3) -> (f64, usize) {
        let query = x.to_array();
        let measure = |face: usize| (distance(x, self.mesh.corners(face)), face);
        let least = |a: (f64, usize), b: (f64, usize)| if b.0 < a.0 { b } else { a };
        let Some(tree) = &self.tree else {
            return (0..self.mesh.faces.len()).map(measure).fold((f64::INFINITY, 0), least);
        };
        let first = tree.query(&query).nearest_one::<SquaredEuclidean<f64>>().execute();
        let best = measure(first.item as usize);
        let radius = best.0 + self.reach;
        let near = tree.query(&query).within::<SquaredEuclidean<f64>>(radius * radius).unsorted().execute();
        near.into_iter().map(|found| measure(found.item as usize)).fold(best, least)
    }
}

/// The distance from a point to a triangle: to the plane where the foot is inside, else to the nearest edge.
fn distance(x: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a);
    let inside = |p: DVec3, q: DVec3| (q - p).cross(x - p).dot(normal) >= 0.0;
    if normal.length_squared() > 0.0 && inside(a, b) && inside(b, c) && inside(c, a) {
        return (x - a).dot(normal.normalize()).abs();
    }
    let edge = |p: DVec3, q: DVec3| {
        let e = q - p;
        let along = ((x - p).dot(e) / e.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (x - p - along * e).length()
    };
    edge(a, b).min(edge(b, c)).min(edge(c, a))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::extract;
    use approx::assert_relative_eq;
    use field::{Shape, Sphere};
    use proptest::prelude::*;

    fn ball(x: f64, radius: f64) -> Mesh {
        let bounds = Sphere { center: DVec3::ZERO, radius: 1.2 };
        extract(&Shape::<f32>::sphere([x, 0.0, 0.0], radius), &bounds, 48, &|_| {})
    }

    #[test]
    fn concentric_spheres_are_as_far_apart_as_their_radii() {
        let c = compare(&ball(0.0, 0.7), &ball(0.0, 0.72), 5000, 0.01);
        assert_relative_eq!(c.chamfer, 0.02, epsilon = 4e-4);
        assert_eq!(c.f_score, 0.0);
        assert!(c.normal_consistency > 0.995);
    }

    #[test]
    fn a_surface_is_at_distance_zero_from_itself() {
        let mesh = ball(0.1, 0.7);
        let c = compare(&mesh, &mesh, 2000, 1e-6);
        assert!(c.chamfer < 1e-7 && c.f_score == 1.0, "{c:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn nearest_is_the_least_over_all_faces(p in prop::array::uniform3(-1.5..1.5f64)) {
            let (mesh, x) = (ball(0.2, 0.6), DVec3::from(p));
            let least = (0..mesh.faces.len()).map(|i| distance(x, mesh.corners(i))).fold(f64::INFINITY, f64::min);
            assert_relative_eq!(Surface::new(&mesh).nearest(x).0, least, epsilon = 1e-12);
        }

        #[test]
        fn triangle_distance_is_the_least_over_its_points(p in prop::array::uniform3(-2.0..2.0f64)) {
            let (x, t) = (DVec3::from(p), [DVec3::ZERO, DVec3::new(1.0, 0.2, 0.0), DVec3::new(0.3, 1.0, 0.4)]);
            let mut least = f64::INFINITY;
            for i in 0..=100 {
                for j in 0..=100 - i {
                    let (u, v) = (f64::from(i) / 100.0, f64::from(j) / 100.0);
                    least = least.min((x - (t[0] * (1.0 - u - v) + t[1] * u + t[2] * v)).length());
                }
            }
            prop_assert!((distance(x, t) - least).abs() < 0.01);
        }
    }
}
