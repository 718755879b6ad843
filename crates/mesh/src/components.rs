//! Connected components of a mesh.

use glam::DVec3;

use crate::Mesh;

/// The connected components of an extracted surface that are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Components {
    /// All of them.
    All,
    /// The one of largest area.
    Largest,
    /// Those with at least this share (0 to 1) of the largest one's area.
    AtLeast(f64),
}

impl Default for Components {
    /// At least 0.01 of the largest one's area.
    ///
    /// This is far below the area of a part of an object that shows in photographs. It is far above
    /// that of the specks that a network leaves where no photograph shows the space.
    fn default() -> Self {
        Components::AtLeast(0.01)
    }
}

/// Disjoint sets of the numbers below a bound (union–find with path halving: Tarjan, van Leeuwen,
/// "Worst-case Analysis of Set Union Algorithms", Journal of the ACM 1984).
pub(crate) struct DisjointSets {
    /// The parent of each number in its tree; the parent of a root is the root itself. A parent is
    /// never larger than its child.
    parent: Vec<u32>,
}

impl DisjointSets {
    /// The sets {0}, {1}, …, {count − 1}.
    pub(crate) fn new(count: usize) -> Self {
        DisjointSets { parent: (0..count as u32).collect() }
    }

    /// The smallest number of the set that holds `v`.
    pub(crate) fn find(&mut self, mut v: u32) -> u32 {
        while self.parent[v as usize] != v {
            self.parent[v as usize] = self.parent[self.parent[v as usize] as usize];
            v = self.parent[v as usize];
        }
        v
    }

    /// Unites the sets that hold `a` and `b`.
    pub(crate) fn union(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}

/// The component of every vertex, as the smallest index of its vertices.
fn component_of_vertices(mesh: &Mesh) -> Vec<u32> {
    let mut sets = DisjointSets::new(mesh.vertices.len());
    for [a, b, c] in &mesh.faces {
        sets.union(*a, *b);
        sets.union(*a, *c);
    }
    (0..mesh.vertices.len() as u32).map(|v| sets.find(v)).collect()
}

/// The number of components that have a face.
pub(crate) fn count(mesh: &Mesh) -> usize {
    let component = component_of_vertices(mesh);
    let mut used = vec![false; component.len()];
    mesh.faces.iter().for_each(|f| used[component[f[0] as usize] as usize] = true);
    used.iter().filter(|u| **u).count()
}

/// Twice the area of each component, at the smallest index of its vertices; 0 elsewhere.
fn double_areas(mesh: &Mesh, component: &[u32]) -> Vec<f64> {
    let mut areas = vec![0.0; mesh.vertices.len()];
    for (i, face) in mesh.faces.iter().enumerate() {
        areas[component[face[0] as usize] as usize] += mesh.face_cross(i).length();
    }
    areas
}

/// The area of the smallest component, as a share of the largest one's; 1 for a mesh without area.
pub(crate) fn smallest_share(mesh: &Mesh) -> f64 {
    let areas = double_areas(mesh, &component_of_vertices(mesh));
    let positive = || areas.iter().copied().filter(|a| *a > 0.0);
    let largest = positive().fold(0.0, f64::max);
    positive().map(|area| area / largest).fold(1.0, f64::min)
}

/// The mesh with the chosen components only, and without unused vertices.
///
/// # Panics
/// If a face has an index beyond the vertices.
pub fn keep_components(mesh: Mesh, which: Components) -> Mesh {
    let component = component_of_vertices(&mesh);
    let areas = double_areas(&mesh, &component);
    let largest = (0..areas.len()).fold(0, |best, c| if areas[c] > areas[best] { c } else { best });
    let is_kept = |i: usize| {
        let c = component[mesh.faces[i][0] as usize] as usize;
        match which {
            Components::All => true,
            Components::Largest => c == largest,
            Components::AtLeast(share) => areas[c] >= share * areas[largest],
        }
    };
    select_faces(&mesh, is_kept)
}

/// A closed mesh without its cavities: components whose faces point into the space that they
/// enclose. No photograph can show a cavity, and a network may have one where nothing speaks
/// against it.
pub(crate) fn without_cavities(mesh: Mesh) -> Mesh {
    let component = component_of_vertices(&mesh);
    let of_face = |i: usize| component[mesh.faces[i][0] as usize] as usize;
    let apex = mesh.vertices.first().map_or(DVec3::ZERO, |v| v.as_dvec3());
    let mut volumes = vec![0.0; component.len()];
    for i in 0..mesh.faces.len() {
        volumes[of_face(i)] += mesh.volume_to(i, apex);
    }
    select_faces(&mesh, |i| volumes[of_face(i)] > 0.0)
}

/// The mesh with the faces whose numbers `is_kept` accepts and their vertices, in the order of
/// first use.
///
/// # Panics
/// If a face that is kept has an index beyond the vertices.
pub fn select_faces(mesh: &Mesh, is_kept: impl Fn(usize) -> bool) -> Mesh {
    const UNUSED: u32 = u32::MAX;
    let mut new_index = vec![UNUSED; mesh.vertices.len()];
    let mut out = Mesh { origin: mesh.origin, ..Mesh::default() };
    for (_, face) in mesh.faces.iter().enumerate().filter(|(i, _)| is_kept(*i)) {
        out.faces.push(face.map(|v| {
            let v = v as usize;
            if new_index[v] == UNUSED {
                new_index[v] = out.vertices.len() as u32;
                out.vertices.push(mesh.vertices[v]);
                out.normals.extend(mesh.normals.get(v));
                out.colors.extend(mesh.colors.get(v));
            }
            new_index[v]
        }));
    }
    out
}
