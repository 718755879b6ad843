//! The nearest point of a triangle mesh.

use std::collections::HashSet;

use glam::DVec3;
use mesh::Mesh;

/// The most faces of a leaf.
const LEAF: usize = 4;

/// Errors of rounding, as a part of the mesh's extent: a box that is farther than the nearest face
/// by less than this is searched too.
const ROUNDING: f64 = 1e-9;

/// An axis-aligned box.
#[derive(Clone, Copy)]
struct Bounds {
    low: DVec3,
    high: DVec3,
}

impl Bounds {
    const EMPTY: Bounds =
        Bounds { low: DVec3::splat(f64::INFINITY), high: DVec3::splat(f64::NEG_INFINITY) };

    fn with(self, x: DVec3) -> Bounds {
        Bounds { low: self.low.min(x), high: self.high.max(x) }
    }

    /// The distance of a point from the box; 0 inside.
    fn distance(&self, x: DVec3) -> f64 {
        (self.low - x).max(x - self.high).max(DVec3::ZERO).length()
    }
}

/// A part of a mesh: some faces, or two parts.
struct Node {
    bounds: Bounds,
    /// The faces of a leaf, as a range of [`FaceTree::faces`].
    faces: [usize; 2],
    /// The second of two parts; the first follows its parent. `None` for a leaf.
    second: Option<usize>,
}

/// A mesh with its faces in a binary tree of boxes.
pub(crate) struct FaceTree<'a> {
    mesh: &'a Mesh,
    /// The faces with an area, or all if none has one. One of each set of equal ones: a query
    /// would measure all of these.
    faces: Vec<usize>,
    /// The whole mesh first; empty for a mesh without faces.
    nodes: Vec<Node>,
    /// A bound of errors of rounding, world units.
    rounding: f64,
}

impl<'a> FaceTree<'a> {
    pub(crate) fn new(mesh: &'a Mesh) -> Self {
        let mut known = HashSet::new();
        let is_new = |i: &usize| known.insert(mesh.faces[*i]);
        let mut faces: Vec<usize> = (0..mesh.faces.len()).filter(is_new).collect();
        let has_area = |i: &usize| has_area(&mesh.corners(*i));
        if faces.iter().any(has_area) {
            faces.retain(has_area);
        }
        let mut tree = FaceTree { mesh, faces, nodes: Vec::new(), rounding: 0.0 };
        if !tree.faces.is_empty() {
            tree.add(0, tree.faces.len());
            let Bounds { low, high } = tree.nodes[0].bounds;
            tree.rounding = ROUNDING * (high - low).length();
        }
        tree
    }

    /// Adds the node of the faces in this range. Those of its parts are halves of them, along the
    /// longest side of the box of their centroids.
    fn add(&mut self, from: usize, to: usize) {
        let mesh = self.mesh;
        let centroid = |face: &usize| mesh.corners(*face).iter().sum::<DVec3>() / 3.0;
        let faces = &mut self.faces[from..to];
        let corners = faces.iter().flat_map(|face| mesh.corners(*face));
        let bounds = corners.fold(Bounds::EMPTY, Bounds::with);
        let (node, count) = (self.nodes.len(), to - from);
        if count > LEAF {
            let Bounds { low, high } = faces.iter().map(centroid).fold(Bounds::EMPTY, Bounds::with);
            let axis = (high - low).max_position();
            faces.select_nth_unstable_by(count / 2, |a, b| {
                centroid(a)[axis].total_cmp(&centroid(b)[axis]).then(a.cmp(b))
            });
        }
        self.nodes.push(Node { bounds, faces: [from, to], second: None });
        if count > LEAF {
            let middle = from + count / 2;
            self.add(from, middle);
            self.nodes[node].second = Some(self.nodes.len());
            self.add(middle, to);
        }
    }

    /// The distance from `x` to the nearest point of the surface, in world units, and its face: the
    /// first one of several at the same distance. Faces without area are no part of the surface:
    /// they have no normal.
    ///
    /// The distance is exact up to rounding. It is infinite (and the face 0) for a mesh without
    /// faces and for a point that is not finite.
    pub(crate) fn nearest(&self, x: DVec3) -> (f64, usize) {
        let mut best = (f64::INFINITY, 0);
        if x.is_finite() && !self.nodes.is_empty() {
            self.search(0, x, &mut best);
        }
        best
    }

    /// Searches the faces of a node for one that is nearer than `best`, in the nearer part first.
    fn search(&self, node: usize, x: DVec3, best: &mut (f64, usize)) {
        let Node { faces: [from, to], second, .. } = self.nodes[node];
        let Some(second) = second else {
            for face in &self.faces[from..to] {
                let distance = triangle_distance(x, &self.mesh.corners(*face));
                if distance < best.0 || (distance == best.0 && *face < best.1) {
                    *best = (distance, *face);
                }
            }
            return;
        };
        let mut parts = [node + 1, second].map(|part| (self.nodes[part].bounds.distance(x), part));
        if parts[1].0 < parts[0].0 {
            parts.swap(0, 1);
        }
        for (distance, part) in parts {
            if distance <= best.0 + self.rounding {
                self.search(part, x, best);
            }
        }
    }
}

/// Twice the area of a triangle over the square of its longest edge. Below this the triangle counts
/// as its three edges: its normal is rounding noise.
const SLIVER: f64 = 1e-12;

/// The edges of a triangle, each with its start.
fn edges([a, b, c]: &[DVec3; 3]) -> [(DVec3, DVec3); 3] {
    [(*a, b - a), (*b, c - b), (*c, a - c)]
}

/// Whether a triangle has more area than a sliver.
fn has_area(corners: &[DVec3; 3]) -> bool {
    let edges = edges(corners);
    let longest = edges.iter().map(|(_, e)| e.length_squared()).fold(0.0, f64::max);
    edges[0].1.cross(edges[1].1).length() > SLIVER * longest
}

/// The distance from a point to a triangle: to its plane if the foot of the perpendicular is in the
/// triangle, else to the nearest edge.
fn triangle_distance(x: DVec3, corners: &[DVec3; 3]) -> f64 {
    let edges = edges(corners);
    let normal = edges[0].1.cross(edges[1].1);
    let inside = edges.iter().all(|(start, edge)| edge.cross(x - start).dot(normal) >= 0.0);
    if inside && has_area(corners) {
        return (x - corners[0]).dot(normal.normalize()).abs();
    }
    edges.iter().map(|edge| nearest_of_edge(x, edge).0).fold(f64::INFINITY, f64::min)
}

/// The distance from a point to an edge, and the place of its nearest point: 0 at the start of the
/// edge, 1 at its end.
fn nearest_of_edge(x: DVec3, (start, edge): &(DVec3, DVec3)) -> (f64, f64) {
    let along =
        ((x - start).dot(*edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    ((x - start - along * edge).length(), along)
}

/// The barycentric weights of the point of a triangle that is nearest to `x`.
pub(crate) fn nearest_weights(x: DVec3, corners: &[DVec3; 3]) -> [f64; 3] {
    let edges = edges(corners);
    let normal = edges[0].1.cross(edges[1].1);
    // Twice the area of the triangle of the foot and the edge that begins at each corner.
    let parts = edges.map(|(start, edge)| edge.cross(x - start).dot(normal));
    if parts.iter().all(|part| *part >= 0.0) && has_area(corners) {
        let sum = parts.iter().sum::<f64>();
        return [parts[1] / sum, parts[2] / sum, parts[0] / sum];
    }
    let mut best = (f64::INFINITY, [1.0, 0.0, 0.0]);
    for (k, edge) in edges.iter().enumerate() {
        let (distance, along) = nearest_of_edge(x, edge);
        if distance < best.0 {
            let mut weights = [0.0; 3];
            weights[k] = 1.0 - along;
            weights[(k + 1) % 3] = along;
            best = (distance, weights);
        }
    }
    best.1
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
            let weights = nearest_weights(x, &t);
            let at = (0..3).map(|k| weights[k] * t[k]).sum::<DVec3>().distance(x);
            prop_assert!((found - at).abs() < 1e-12, "{found} against {at}");
            let sum = weights.iter().sum::<f64>();
            prop_assert!((sum - 1.0).abs() < 1e-12 && weights.iter().all(|w| *w >= 0.0));
        }

        #[test]
        fn the_nearest_face_is_the_first_of_the_nearest_with_an_area(
            vertices in points(3..60),
            pick in prop::collection::vec(any::<[u32; 3]>(), 1..80),
            x in points(8..9),
        ) {
            let faces = pick.iter().map(|f| f.map(|v| v % vertices.len() as u32)).collect();
            let mesh = Mesh { vertices, faces, ..Mesh::default() };
            let tree = FaceTree::new(&mesh);
            let all: Vec<usize> = (0..mesh.faces.len()).collect();
            let with_area: Vec<usize> =
                all.iter().copied().filter(|i| has_area(&mesh.corners(*i))).collect();
            let faces = if with_area.is_empty() { all } else { with_area };
            for x in x {
                let x = 2.0 * x.as_dvec3();
                let (found, face) = tree.nearest(x);
                let distance = |i: usize| triangle_distance(x, &mesh.corners(i));
                let least = faces.iter().map(|i| distance(*i)).fold(f64::INFINITY, f64::min);
                prop_assert_eq!(found, least);
                prop_assert_eq!(Some(&face), faces.iter().find(|i| distance(**i) == least));
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
