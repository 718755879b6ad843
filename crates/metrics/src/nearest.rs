//! The nearest point of a triangle mesh.

use std::collections::HashSet;

use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use mesh::Mesh;

/// A mesh with the centroids of its faces in a k-d tree.
pub(crate) struct FaceTree<'a> {
    mesh: &'a Mesh,
    /// The faces, one of each set of equal ones: a query would measure all of these.
    faces: Vec<usize>,
    /// `None` if the tree cannot be built: for a mesh without faces, and where hundreds of
    /// centroids are equal. Then a query measures every face.
    centroids: Option<ImmutableKdTree<f64, 3>>,
    /// The largest distance of a corner from the centroid of its face, world units.
    reach: f64,
}

impl<'a> FaceTree<'a> {
    pub(crate) fn new(mesh: &'a Mesh) -> Self {
        let centroid = |i: usize| mesh.corners(i).iter().sum::<DVec3>() / 3.0;
        let mut known = HashSet::new();
        let is_new = |i: &usize| known.insert(mesh.faces[*i]);
        let faces: Vec<usize> = (0..mesh.faces.len()).filter(is_new).collect();
        let centroids: Vec<[f64; 3]> = faces.iter().map(|i| centroid(*i).to_array()).collect();
        let reach = faces
            .iter()
            .flat_map(|i| mesh.corners(*i).map(|c| (c - centroid(*i)).length()))
            .fold(0.0, f64::max);
        // A query of an empty tree panics.
        let centroids = Some(centroids).filter(|c| !c.is_empty());
        FaceTree {
            mesh,
            faces,
            centroids: centroids.and_then(|c| ImmutableKdTree::new_from_slice(&c).ok()),
            reach,
        }
    }

    /// The distance from `x` to the nearest point of the surface, in world units, and its face.
    ///
    /// The distance is exact up to rounding. The face of the nearest centroid gives an upper bound
    /// of the distance. A nearer face has its centroid within that bound plus `reach`, so all faces
    /// with such a centroid are measured. The distance is infinite (and the face 0) for a mesh
    /// without faces and for a point that is not finite.
    pub(crate) fn nearest(&self, x: DVec3) -> (f64, usize) {
        let measure = |face: usize| (triangle_distance(x, &self.mesh.corners(face)), face);
        let nearer = |a: (f64, usize), b: (f64, usize)| if b.0 < a.0 { b } else { a };
        let Some(tree) = self.centroids.as_ref().filter(|_| x.is_finite()) else {
            return self.faces.iter().copied().map(measure).fold((f64::INFINITY, 0), nearer);
        };
        let query = x.to_array();
        let first = tree.query(&query).nearest_one::<SquaredEuclidean<f64>>().execute();
        let bound = measure(self.faces[first.item as usize]);
        let radius = bound.0 + self.reach;
        let candidates = tree
            .query(&query)
            .within::<SquaredEuclidean<f64>>(radius * radius)
            .unsorted()
            .execute();
        candidates.into_iter().map(|c| measure(self.faces[c.item as usize])).fold(bound, nearer)
    }
}

/// Twice the area of a triangle over the square of its longest edge. Below this the triangle counts
/// as its three edges: its normal is rounding noise.
const SLIVER: f64 = 1e-12;

/// The distance from a point to a triangle: to its plane if the foot of the perpendicular is in the
/// triangle, else to the nearest edge.
fn triangle_distance(x: DVec3, [a, b, c]: &[DVec3; 3]) -> f64 {
    let edges = [(*a, b - a), (*b, c - b), (*c, a - c)];
    let normal = edges[0].1.cross(edges[1].1);
    let longest = edges.iter().map(|(_, e)| e.length_squared()).fold(0.0, f64::max);
    let inside = edges.iter().all(|(start, edge)| edge.cross(x - start).dot(normal) >= 0.0);
    if inside && normal.length() > SLIVER * longest {
        return (x - a).dot(normal.normalize()).abs();
    }
    let edge_distance = |(start, edge): &(DVec3, DVec3)| {
        let along =
            ((x - start).dot(*edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (x - start - along * edge).length()
    };
    edges.iter().map(edge_distance).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use proptest::prelude::*;

    fn points(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Vec3>> {
        prop::collection::vec(prop::array::uniform3(-1.0..1.0f32).prop_map(Vec3::from), count)
    }

    /// The distance to a triangle by descent over barycentric weights, along the three edge
    /// directions in turn. The squared distance is smooth and convex, so this finds its minimum.
    fn searched_distance(x: DVec3, [p, q, r]: [DVec3; 3]) -> f64 {
        let at = |w: [f64; 3]| (x - (p * w[0] + q * w[1] + r * w[2])).length_squared();
        let mut w = [1.0 / 3.0; 3];
        for _ in 0..400 {
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                let (mut low, mut high) = (-w[i], w[j]);
                for _ in 0..60 {
                    let moved = |t: f64| {
                        let mut w = w;
                        (w[i], w[j]) = (w[i] + t, w[j] - t);
                        at(w)
                    };
                    let third = (high - low) / 3.0;
                    if moved(low + third) < moved(high - third) {
                        high -= third
                    } else {
                        low += third
                    }
                }
                (w[i], w[j]) = (w[i] + low, w[j] - low);
            }
        }
        at(w).sqrt()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn the_distance_to_a_triangle_is_the_least_over_its_points(
            t in points(3..4),
            x in points(1..2),
        ) {
            let t = [t[0], t[1], t[2]].map(|v| v.as_dvec3());
            prop_assume!((t[1] - t[0]).cross(t[2] - t[0]).length() > 0.05);
            let x = x[0].as_dvec3();
            let (found, searched) = (triangle_distance(x, &t), searched_distance(x, t));
            prop_assert!((found - searched).abs() < 1e-4, "{found} against {searched}");
        }

        #[test]
        fn the_nearest_face_is_the_nearest_of_all(
            vertices in points(3..60),
            pick in prop::collection::vec(any::<[u32; 3]>(), 1..80),
            x in points(8..9),
        ) {
            let faces = pick.iter().map(|f| f.map(|v| v % vertices.len() as u32)).collect();
            let mesh = Mesh { vertices, faces, ..Mesh::default() };
            let tree = FaceTree::new(&mesh);
            for x in x {
                let x = 2.0 * x.as_dvec3();
                let (found, face) = tree.nearest(x);
                let distance = |i: usize| triangle_distance(x, &mesh.corners(i));
                let least = (0..mesh.faces.len()).map(distance).fold(f64::INFINITY, f64::min);
                prop_assert_eq!(found, least);
                prop_assert_eq!(distance(face), least);
            }
        }
    }

    #[test]
    fn degenerate_triangles_count_as_their_edges() {
        let x = DVec3::new(0.25, 1.0, 0.0);
        assert_eq!(triangle_distance(x, &[DVec3::ZERO, DVec3::X, DVec3::X * 0.5]), 1.0);
        assert_eq!(triangle_distance(x, &[DVec3::ZERO; 3]), x.length());
        let sliver = [DVec3::ZERO, DVec3::X, DVec3::new(0.5, 1e-17, 0.0)];
        assert_eq!(triangle_distance(x, &sliver), 1.0);
        assert_eq!(triangle_distance(DVec3::NAN, &sliver), f64::INFINITY);
    }

    #[test]
    fn a_mesh_without_faces_is_infinitely_far() {
        assert_eq!(FaceTree::new(&Mesh::default()).nearest(DVec3::ZERO).0, f64::INFINITY);
    }
}
