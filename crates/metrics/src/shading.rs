//! The normals of a surface as its photographs show them: interpolated over its faces.

use glam::DVec3;
use mesh::Mesh;

use crate::sample::Place;

/// The angle, in degrees, up to which the normals of two faces at a vertex are taken for those of
/// one smooth surface.
const SMOOTH: f64 = 30.0;

/// The most faces at a vertex whose normals are compared with each other: their pairs cost time.
const MOST_FACES: usize = 256;

/// An interpolated normal differs from that of its face by more than this, in radians.
const ROUNDING: f64 = 1e-6;

/// Which normals a surface is compared by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Normals {
    /// Those of its file's vertices, interpolated over the faces.
    OfVertices,
    /// Means over the faces at a vertex that meet at 30° or less, by their angles there,
    /// interpolated over the faces. Edges of more than that stay sharp.
    Smoothed,
    /// Those of the flat faces.
    OfFaces,
}

/// The normals of a mesh's corners.
pub(crate) struct Shading<'a> {
    /// The mesh.
    pub(crate) mesh: &'a Mesh,
    /// The unit normals at the three corners of each face; 0 if they are not known.
    corners: Vec<[DVec3; 3]>,
    /// Which normals these are.
    pub(crate) normals: Normals,
}

impl<'a> Shading<'a> {
    /// The normals of the vertices, if the mesh has them, or else smoothed ones.
    pub(crate) fn of(mesh: &'a Mesh) -> Self {
        if mesh.normals.len() == mesh.vertices.len() {
            let normal = |v: u32| mesh.normals[v as usize].as_dvec3().normalize_or_zero();
            let corners = mesh.faces.iter().map(|face| face.map(normal)).collect();
            return Shading { mesh, corners, normals: Normals::OfVertices };
        }
        let flat: Vec<DVec3> =
            (0..mesh.faces.len()).map(|i| mesh.face_cross(i).normalize_or_zero()).collect();
        let corners = smoothed(mesh, &flat);
        let is_flat = |(own, corners): (&DVec3, &[DVec3; 3])| {
            corners.iter().all(|corner| corner.distance(*own) <= ROUNDING)
        };
        let is_flat = flat.iter().zip(&corners).all(is_flat);
        let normals = if is_flat { Normals::OfFaces } else { Normals::Smoothed };
        Shading { mesh, corners, normals }
    }

    /// The unit normal at a place: that of the flat face where the normals of the corners cancel
    /// out.
    pub(crate) fn at(&self, Place { face, weights }: &Place) -> DVec3 {
        let sum: DVec3 = (0..3).map(|k| weights[k] * self.corners[*face][k]).sum();
        sum.try_normalize().unwrap_or_else(|| self.mesh.face_cross(*face).normalize_or_zero())
    }
}

/// The mean of the normals of the faces at each corner that are within [`SMOOTH`] of its own face,
/// weighed by their angles at the vertex.
fn smoothed(mesh: &Mesh, flat: &[DVec3]) -> Vec<[DVec3; 3]> {
    let mut at_vertex: Vec<Vec<(usize, f64)>> = vec![Vec::new(); mesh.vertices.len()];
    for (i, face) in mesh.faces.iter().enumerate() {
        let corners = mesh.corners(i);
        for k in 0..3 {
            let [to, from] = [1, 2].map(|step| corners[(k + step) % 3] - corners[k]);
            let angle = to.cross(from).length().atan2(to.dot(from));
            at_vertex[face[k] as usize].push((i, angle));
        }
    }
    let least = SMOOTH.to_radians().cos();
    let corner = |own: usize, vertex: u32| {
        let around = &at_vertex[vertex as usize];
        if around.len() > MOST_FACES {
            return flat[own];
        }
        let near = around.iter().filter(|(face, _)| flat[*face].dot(flat[own]) >= least);
        let sum: DVec3 = near.map(|(face, angle)| *angle * flat[*face]).sum();
        sum.try_normalize().unwrap_or(flat[own])
    };
    mesh.faces.iter().enumerate().map(|(i, face)| face.map(|vertex| corner(i, vertex))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// A prism around the z axis with this number of sides, without its ends.
    fn prism(sides: u32) -> Mesh {
        let angle = |i: u32| std::f32::consts::TAU * (i % sides) as f32 / sides as f32;
        let vertex = |i: u32, z: f32| Vec3::new(angle(i).cos(), angle(i).sin(), z);
        let vertices = (0..sides).flat_map(|i| [vertex(i, 0.0), vertex(i, 1.0)]).collect();
        let side = |i: u32| {
            let [a, b] = [2 * i, 2 * ((i + 1) % sides)];
            [[a, b, b + 1], [a, b + 1, a + 1]]
        };
        Mesh { vertices, faces: (0..sides).flat_map(side).collect(), ..Mesh::default() }
    }

    #[test]
    fn a_cylinder_is_smooth_and_a_box_is_not() {
        // Sides of 15 degrees: at a corner, the normals of two sides and of their triangles
        // average to that of the cylinder, up to the triangles' different angles.
        let mesh = prism(24);
        let shading = Shading::of(&mesh);
        assert_eq!(shading.normals, Normals::Smoothed);
        for (face, corners) in mesh.faces.iter().enumerate() {
            for (k, v) in corners.iter().enumerate() {
                let expected = mesh.vertices[*v as usize].with_z(0.0).as_dvec3();
                let weights = std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
                let found = shading.at(&Place { face, weights });
                assert!(found.distance(expected) < 1e-6, "{found} for {expected}");
            }
            // In the middle of a side, the interpolated normal is that of the side.
            let middle = shading.at(&Place { face, weights: [0.5, 0.0, 0.5] });
            let flat = mesh.face_cross(face).normalize();
            assert!(face % 2 == 1 || middle.dot(flat) > 0.999, "{middle} for {flat}");
        }
        let shading = Shading::of(&mesh);
        assert!(
            shading
                .at(&Place { face: 0, weights: [0.0; 3] })
                .distance(mesh.face_cross(0).normalize())
                < 1e-12
        );
        let square = prism(4);
        let shading = Shading::of(&square);
        assert_eq!(shading.normals, Normals::OfFaces);
        assert_eq!(
            shading.at(&Place { face: 1, weights: [0.2, 0.3, 0.5] }),
            square.face_cross(1).normalize()
        );
    }

    #[test]
    fn the_normals_of_a_file_count_before_those_of_the_faces() {
        let normals = vec![Vec3::X * 2.0; 48];
        let mesh = Mesh { normals, ..prism(24) };
        let shading = Shading::of(&mesh);
        assert_eq!(
            (shading.normals, shading.at(&Place { face: 3, weights: [0.2, 0.3, 0.5] })),
            (Normals::OfVertices, DVec3::X)
        );
    }

    #[test]
    fn a_vertex_of_very_many_faces_keeps_the_normals_of_the_faces() {
        let mut mesh = prism(24);
        mesh.faces = mesh.faces.repeat(200);
        assert_eq!(Shading::of(&mesh).normals, Normals::OfFaces);
    }
}
