//! Connected pieces of a mesh.

use super::Mesh;

/// The piece of every vertex, as the index of one of its vertices.
fn roots(mesh: &Mesh) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    fn find(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for [a, b, c] in &mesh.faces {
        for other in [b, c] {
            let (x, y) = (find(&mut parent, *a), find(&mut parent, *other));
            parent[x.max(y) as usize] = x.min(y);
        }
    }
    (0..parent.len() as u32).map(|v| find(&mut parent, v)).collect()
}

/// Faces of every piece, by its root.
fn sizes(mesh: &Mesh, roots: &[u32]) -> Vec<usize> {
    let mut sizes = vec![0; mesh.vertices.len()];
    mesh.faces.iter().for_each(|f| sizes[roots[f[0] as usize] as usize] += 1);
    sizes
}

/// The number of pieces.
pub(super) fn count(mesh: &Mesh) -> usize {
    sizes(mesh, &roots(mesh)).iter().filter(|n| **n > 0).count()
}

/// The mesh without pieces that have less than `share` of the largest one's faces, and without unused vertices.
pub(super) fn without_small(mesh: Mesh, share: f64) -> Mesh {
    let roots = roots(&mesh);
    let sizes = sizes(&mesh, &roots);
    let least = share * sizes.iter().copied().max().unwrap_or(0) as f64;
    let mut index = vec![u32::MAX; mesh.vertices.len()];
    let mut out = Mesh::default();
    for face in &mesh.faces {
        if (sizes[roots[face[0] as usize] as usize] as f64) < least {
            continue;
        }
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
