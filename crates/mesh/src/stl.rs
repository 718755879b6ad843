//! Reading and writing of .stl files.
//!
//! The format has triangles of positions in single precision, and no list of vertices.

#![warn(clippy::cast_possible_truncation)]

use std::io::{self, Cursor, Write};
use std::path::Path;

use files::InputError;
use glam::DVec3;

use crate::Mesh;
use crate::bytes::little_endian;

/// The bytes before the number of triangles; they have no meaning.
const HEADER_BYTES: usize = 80;

/// The bytes of a triangle: a normal, three positions, and a number without a meaning.
const TRIANGLE_BYTES: usize = 50;

/// Writes the mesh as a binary .stl file.
pub(crate) fn write_stl(mesh: &Mesh, out: &mut dyn Write) -> io::Result<()> {
    let mut header = [b' '; HEADER_BYTES];
    header[..4].copy_from_slice(b"dsdf");
    out.write_all(&header)?;
    let faces = u32::try_from(mesh.faces.len()).map_err(io::Error::other)?;
    out.write_all(&faces.to_le_bytes())?;
    for (i, face) in mesh.faces.iter().enumerate() {
        let normal = mesh.face_cross(i).normalize_or_zero().as_vec3();
        let corners = face.map(|v| (mesh.origin + mesh.vertices[v as usize].as_dvec3()).as_vec3());
        for v in std::iter::once(normal).chain(corners) {
            out.write_all(&little_endian(v.to_array().map(f32::to_bits)))?;
        }
        out.write_all(&[0; 2])?;
    }
    Ok(())
}

/// Reads a .stl file, binary or text. Equal positions become one vertex.
pub(crate) fn parse_stl(path: &Path, bytes: &[u8]) -> Result<Mesh, InputError> {
    let count = bytes.get(HEADER_BYTES..HEADER_BYTES + 4).and_then(|b| b.try_into().ok());
    let count = count.map_or(0, |b| u32::from_le_bytes(b) as usize);
    let binary = HEADER_BYTES + 4 + TRIANGLE_BYTES * count;
    let is_text = bytes.starts_with(b"solid") && bytes.len() != binary;
    if !is_text && bytes.len() < binary.max(HEADER_BYTES + 4) {
        let found = format!("{} bytes", bytes.len());
        let expected = format!("{binary} bytes for {count} triangles");
        return Err(InputError::new(path, "mesh", found, expected));
    }
    let mut bytes = bytes.to_vec();
    if !is_text {
        // Some programs begin the header of a binary file with the word of a text file.
        bytes[..HEADER_BYTES].fill(0);
    }
    let read = stl_io::read_stl(&mut Cursor::new(bytes))
        .map_err(|e| InputError::new(path, "mesh", e, "an STL mesh"))?;
    let position = |v: &stl_io::Vertex| DVec3::from(v.0.map(f64::from));
    let vertices: Vec<DVec3> = read.vertices.iter().map(position).collect();
    if u32::try_from(vertices.len()).is_err() {
        return Err(InputError::new(path, "vertices", vertices.len(), "fewer than 2^32"));
    }
    #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 vertices")]
    let faces = read.faces.iter().map(|f| f.vertices.map(|v| v as u32)).collect();
    Ok(Mesh { faces, ..Mesh::of_vertices(&vertices) })
}
