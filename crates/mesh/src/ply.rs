//! Writing of .ply files.

use std::io::{self, Write};

use crate::Mesh;
use crate::bytes::little_endian;

/// Writes the mesh as a binary .ply file, little endian.
pub(crate) fn write_ply(mesh: &Mesh, out: &mut dyn Write) -> io::Result<()> {
    let (normals, colors) = (mesh.has_normals(), mesh.has_colors());
    write_ply_header(mesh, out)?;
    for (i, v) in mesh.vertices.iter().enumerate() {
        if mesh.is_far() {
            let position = (mesh.origin + v.as_dvec3()).to_array();
            position.iter().try_for_each(|c| out.write_all(&c.to_le_bytes()))?;
        } else {
            out.write_all(&little_endian(v.to_array().map(f32::to_bits)))?;
        }
        if normals {
            out.write_all(&little_endian(mesh.normals[i].to_array().map(f32::to_bits)))?;
        }
        if colors {
            out.write_all(&mesh.srgb(i).map(|c| (c * 255.0).round() as u8))?;
        }
    }
    for face in &mesh.faces {
        out.write_all(&[3])?;
        out.write_all(&little_endian(*face))?;
    }
    Ok(())
}

fn write_ply_header(mesh: &Mesh, out: &mut dyn Write) -> io::Result<()> {
    let (vertices, faces) = (mesh.vertices.len(), mesh.faces.len());
    writeln!(out, "ply\nformat binary_little_endian 1.0\ncomment dsdf\nelement vertex {vertices}")?;
    let position = if mesh.is_far() { "double" } else { "float" };
    for name in ["x", "y", "z"] {
        writeln!(out, "property {position} {name}")?;
    }
    for name in ["nx", "ny", "nz"].iter().filter(|_| mesh.has_normals()) {
        writeln!(out, "property float {name}")?;
    }
    for name in ["red", "green", "blue"].iter().filter(|_| mesh.has_colors()) {
        writeln!(out, "property uchar {name}")?;
    }
    writeln!(out, "element face {faces}\nproperty list uchar int vertex_indices\nend_header")?;
    Ok(())
}
