//! Cuts of a mesh, one after the other, with the size of each.

use mesh::{Mesh, select_faces};

/// A cut: the faces that it removed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The number of removed faces.
    pub faces: usize,
    /// Their area, as a part of the area of the whole mesh, 0 to 1.
    pub area: f64,
}

/// A mesh that is being cut along its edges.
///
/// Cuts are given by flags of the vertices. All are about the whole mesh, so their order changes
/// only the step that a face is counted in.
#[derive(Debug)]
pub struct Cutter<'a> {
    mesh: &'a Mesh,
    kept: Vec<bool>,
    areas: Vec<f64>,
}

impl<'a> Cutter<'a> {
    /// A mesh of which nothing is cut off.
    pub fn new(mesh: &'a Mesh) -> Self {
        let areas = (0..mesh.faces.len()).map(|i| 0.5 * mesh.face_cross(i).length()).collect();
        Cutter { mesh, kept: vec![true; mesh.faces.len()], areas }
    }

    /// Removes the faces without a flagged corner. `flags` has one flag per vertex.
    ///
    /// For flags of which single ones may be wrong: a hole needs several.
    pub fn keep_touching(&mut self, flags: &[bool]) -> Step {
        self.keep(|face| face.iter().any(|v| flags[*v as usize]))
    }

    /// Removes the faces with a corner that is not flagged. `flags` has one flag per vertex.
    pub fn keep_inside(&mut self, flags: &[bool]) -> Step {
        self.keep(|face| face.iter().all(|v| flags[*v as usize]))
    }

    fn keep(&mut self, is_kept: impl Fn(&[u32; 3]) -> bool) -> Step {
        let (mut faces, mut area) = (0, 0.0);
        for (i, face) in self.mesh.faces.iter().enumerate() {
            if self.kept[i] && !is_kept(face) {
                self.kept[i] = false;
                faces += 1;
                area += self.areas[i];
            }
        }
        Step { faces, area: self.part(area) }
    }

    /// The step from this mesh to `rest`, a part of [`mesh`](Self::mesh).
    pub fn step_to(&self, rest: &Mesh) -> Step {
        let kept = self.kept.iter().zip(&self.areas).filter(|(kept, _)| **kept);
        let (mut faces, mut area) = (0, 0.0);
        for (_, face) in kept {
            faces += 1;
            area += face;
        }
        let area = self.part(area - rest.area()).max(0.0);
        Step { faces: faces - rest.faces.len().min(faces), area }
    }

    /// A share of the area of the whole mesh; 0 of a mesh without area.
    fn part(&self, area: f64) -> f64 {
        let total: f64 = self.areas.iter().sum();
        if total > 0.0 { area / total } else { 0.0 }
    }

    /// The faces that are left, and their vertices.
    pub fn mesh(&self) -> Mesh {
        select_faces(self.mesh, |i| self.kept[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, Vec3};

    /// A strip of four triangles: the first two have the area 1/2, the others 1.
    fn strip() -> Mesh {
        let corner = |x: f32, y: f32| Vec3::new(x, y, 0.0);
        Mesh {
            origin: DVec3::X,
            vertices: [(0., 0.), (0., 1.), (1., 0.), (1., 1.), (3., 0.), (3., 1.)]
                .map(|(x, y)| corner(x, y))
                .to_vec(),
            faces: vec![[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]],
            ..Mesh::default()
        }
    }

    #[test]
    fn steps_count_each_face_once_and_the_rest_keeps_its_place() {
        let mesh = strip();
        let mut cutter = Cutter::new(&mesh);
        // Vertex 0 alone is outside: only its face has no other corner to hold it.
        let step = cutter.keep_inside(&[false, true, true, true, true, true]);
        assert_eq!(step, Step { faces: 1, area: 0.5 / 3.0 });
        let step = cutter.keep_touching(&[true, true, true, false, false, false]);
        assert_eq!(step, Step { faces: 1, area: 1.0 / 3.0 });
        let rest = cutter.mesh();
        assert_eq!((rest.faces.len(), rest.vertices.len(), rest.origin), (2, 4, DVec3::X));
        assert_eq!(rest.area(), 1.5);
        let one = Mesh { faces: vec![[0, 1, 2]], ..rest };
        assert_eq!(cutter.step_to(&one), Step { faces: 1, area: (1.5 - one.area()) / 3.0 });
        let empty = Mesh::default();
        let mut nothing = Cutter::new(&empty);
        assert_eq!(nothing.keep_inside(&[]), Step { faces: 0, area: 0.0 });
    }
}
