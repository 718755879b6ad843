//! Connected pieces of a mesh.

use super::Mesh;

/// Which connected pieces of an extracted surface are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Components {
    /// All of them.
    All,
    /// The one of largest area.
    Largest,
    /// Those with at least this share of the largest one's area.
    AtLeast(f64),
}

impl Default for Components {
    /// Drops dust: a hundredth of the largest piece's area is far below a part of an object that
    /// photographs show, and far above the specks that a network leaves in places that no
    /// photograph sees.
    fn default() -> Self {
        Components::AtLeast(0.01)
    }
}

/// Disjoint sets of the numbers below a bound.
pub(super) struct Sets(Vec<u32>);

impl Sets {
    /// Every number by itself.
    pub(super) fn new(count: usize) -> Self {
        Sets((0..count as u32).collect())
    }

    /// The least number of the set that holds `v`.
    pub(super) fn root(&mut self, mut v: u32) -> u32 {
        while self.0[v as usize] != v {
            self.0[v as usize] = self.0[self.0[v as usize] as usize];
            v = self.0[v as usize];
        }
        v
    }

    /// Makes one set of two.
    pub(super) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// The piece of every vertex, as the index of one of its vertices.
fn roots(mesh: &Mesh) -> Vec<u32> {
    let mut sets = Sets::new(mesh.vertices.len());
    for [a, b, c] in &mesh.faces {
        sets.join(*a, *b);
        sets.join(*a, *c);
    }
    (0..mesh.vertices.len() as u32).map(|v| sets.root(v)).collect()
}

/// The number of pieces.
pub(super) fn count(mesh: &Mesh) -> usize {
    let roots = roots(mesh);
    let mut used = vec![false; roots.len()];
    mesh.faces.iter().for_each(|f| used[roots[f[0] as usize] as usize] = true);
    used.iter().filter(|u| **u).count()
}

/// The mesh with the chosen pieces only, and without unused vertices.
pub(super) fn keep(mesh: Mesh, which: Components) -> Mesh {
    let roots = roots(&mesh);
    let mut areas = vec![0.0; mesh.vertices.len()];
    for (i, face) in mesh.faces.iter().enumerate() {
        areas[roots[face[0] as usize] as usize] += mesh.face_cross(i).length();
    }
    let largest = (0..areas.len()).fold(0, |best, v| if areas[v] > areas[best] { v } else { best });
    let wanted = |root: usize| match which {
        Components::All => true,
        Components::Largest => root == largest,
        Components::AtLeast(share) => areas[root] >= share * areas[largest],
    };
    let mut index = vec![u32::MAX; mesh.vertices.len()];
    let mut out = Mesh::default();
    for face in mesh.faces.iter().filter(|f| wanted(roots[f[0] as usize] as usize)) {
        out.faces.push(face.map(|v| {
            if index[v as usize] == u32::MAX {
                index[v as usize] = out.vertices.len() as u32;
                out.vertices.push(mesh.vertices[v as usize]);
                out.normals.extend(mesh.normals.get(v as usize));
            }
            index[v as usize]
        }));
    }
    out
}
