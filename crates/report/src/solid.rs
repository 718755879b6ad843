//! The surface of a run as buffers for the page.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use export::bake::bake;
use film::srgb_encode;
use fit::Solid;
use glam::{DVec3, Vec3};
use mesh::{Mesh, decimate, extract};
use render::{Camera, InvalidField, upwards};
use serde::Serialize;

use crate::{Detail, Run};

/// The bounding sphere of a run, and its upward direction. Lengths are in the units of the data
/// set, relative to the origin of the run.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Frame {
    center: [f64; 3],
    radius: f64,
    up: [f64; 3],
}

impl Frame {
    pub(crate) fn of(run: &Run<'_>) -> Self {
        let sphere = run.file.sphere();
        let cameras = training_cameras(run);
        let up = if cameras.is_empty() { DVec3::Z } else { upwards(&cameras, sphere.center) };
        Frame { center: sphere.center.to_array(), radius: sphere.radius, up: up.to_array() }
    }
}

/// A mesh as buffers in base64. Numbers are little-endian.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Buffers {
    vertices: usize,
    faces: usize,
    /// The corner of the box around the vertices with the least coordinates.
    low: [f32; 3],
    /// The size of this box.
    size: [f32; 3],
    /// Three numbers of 16 bits a vertex: its place in the box, 0 to 65535.
    positions: String,
    /// Three signed bytes a vertex: its unit normal times 127.
    normals: String,
    /// Three bytes a vertex: sRGB.
    colors: String,
    /// Three numbers of 32 bits a face.
    indices: String,
}

/// The surface of the run, with colours; `None` if it has none.
pub(crate) fn mesh(
    run: &Run<'_>,
    solid: &Solid<'_>,
    detail: Detail,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Option<Buffers>, InvalidField> {
    let sphere = run.file.sphere();
    let mesh = extract(&run.model.field, &sphere, detail.cells, &|p| progress(0.7 * p));
    if mesh.faces.is_empty() {
        return Ok(None);
    }
    let mesh = decimate(&mesh, detail.faces);
    let cameras = training_cameras(run);
    let scene = solid.scene(&cameras);
    let colors = bake(&scene, &mesh.vertices, &mesh.normals, &|p| progress(0.7 + 0.3 * p))?.colors;
    Ok((!mesh.faces.is_empty()).then(|| Buffers::of(&Mesh { colors, ..mesh })))
}

fn training_cameras(run: &Run<'_>) -> Vec<Camera> {
    run.dataset.train.iter().map(|view| view.camera).collect()
}

impl Buffers {
    fn of(mesh: &Mesh) -> Self {
        let fold = |of: fn(Vec3, Vec3) -> Vec3| mesh.vertices.iter().copied().reduce(of);
        let low = fold(Vec3::min).unwrap_or_default();
        let size = fold(Vec3::max).unwrap_or_default() - low;
        let scale = Vec3::splat(65_535.0) / size.max(Vec3::splat(f32::MIN_POSITIVE));
        let place = |v: &Vec3| ((*v - low) * scale).round().to_array().map(|x| x as u16);
        let normal = |n: &Vec3| (*n * 127.0).round().to_array().map(|x| x as i8);
        let color = |c: &Vec3| c.to_array().map(|x| (255.0 * srgb_encode(x)).round() as u8);
        Buffers {
            vertices: mesh.vertices.len(),
            faces: mesh.faces.len(),
            low: low.to_array(),
            size: size.to_array(),
            positions: base64(&each(&mesh.vertices, place)),
            normals: base64(&each(&mesh.normals, normal)),
            colors: base64(&each(&mesh.colors, color)),
            indices: base64(&each(&mesh.faces, |face| *face)),
        }
    }
}

/// The numbers of all elements.
fn each<T, N>(elements: &[T], of: impl Fn(&T) -> [N; 3]) -> Vec<N> {
    elements.iter().flat_map(of).collect()
}

fn base64<N: bytemuck::NoUninit>(numbers: &[N]) -> String {
    STANDARD.encode(bytemuck::cast_slice(numbers))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vertex_comes_back_within_half_a_step_of_the_box() {
        let vertices = vec![Vec3::new(-1.0, 2.0, 0.3), Vec3::new(1.0, 2.5, 0.3), Vec3::ONE];
        let normals = vec![Vec3::X, Vec3::NEG_Y, Vec3::Z];
        let colors = vec![Vec3::ZERO, Vec3::ONE, Vec3::splat(0.214_04)];
        let mesh = Mesh { vertices, normals, colors, faces: vec![[0, 1, 2]], ..Mesh::default() };
        let buffers = Buffers::of(&mesh);
        let bytes = STANDARD.decode(&buffers.positions).unwrap();
        let numbers: Vec<u16> = bytes.chunks(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
        for (vertex, place) in mesh.vertices.iter().zip(numbers.chunks(3)) {
            for axis in 0..3 {
                let part = f32::from(place[axis]) / 65_535.0;
                let found = buffers.low[axis] + buffers.size[axis] * part;
                assert!((found - vertex[axis]).abs() <= buffers.size[axis] / 131_070.0 + 1e-6);
            }
        }
        assert_eq!(STANDARD.decode(&buffers.normals).unwrap()[..6], [127, 0, 0, 0, 129, 0]);
        assert_eq!(STANDARD.decode(&buffers.colors).unwrap()[3..9], [255, 255, 255, 127, 127, 127]);
        assert_eq!(STANDARD.decode(&buffers.indices).unwrap().len(), 12);
    }
}
