//! Writing of mesh files: .ply, .obj and .glb.

use std::io::Write;
use std::path::Path;

use glam::DVec3;
use io::{InputError, atomic_write};

use crate::bytes::little_endian;
use crate::glb::write_glb;
use crate::{Mesh, extension};

/// Writes a mesh in the format of its extension: .ply (binary, little endian), .obj or .glb (binary
/// glTF 2.0). Normals are written if each vertex has one. Positions are in world units. A mesh with
/// an origin of its own has them in double precision; a .glb has the origin as the translation of
/// its node. A file at `path` is replaced whole.
///
/// # Errors
/// An [`InputError`] if the extension is another one or the folder does not accept files. Other
/// errors if the file cannot be written, or is a .glb of more than 4 GiB.
pub fn write_mesh(path: &Path, mesh: &Mesh) -> anyhow::Result<()> {
    let write: fn(&Mesh, &mut dyn Write) -> anyhow::Result<()> = match extension(path).as_str() {
        "ply" => write_ply,
        "obj" => write_obj,
        "glb" => write_glb,
        other => {
            let found = format!("extension \"{other}\"");
            return Err(InputError::new(path, "output", found, ".ply, .obj or .glb").into());
        }
    };
    atomic_write(path, |out| write(mesh, out))
}

/// Whether positions need double precision.
fn is_far(mesh: &Mesh) -> bool {
    mesh.origin != DVec3::ZERO
}

fn write_ply(mesh: &Mesh, out: &mut dyn Write) -> anyhow::Result<()> {
    let normals = mesh.has_normals();
    write_ply_header(mesh, normals, out)?;
    for (i, v) in mesh.vertices.iter().enumerate() {
        if is_far(mesh) {
            let position = (mesh.origin + v.as_dvec3()).to_array();
            position.iter().try_for_each(|c| out.write_all(&c.to_le_bytes()))?;
        } else {
            out.write_all(&little_endian(v.to_array().map(f32::to_bits)))?;
        }
        if normals {
            out.write_all(&little_endian(mesh.normals[i].to_array().map(f32::to_bits)))?;
        }
    }
    for face in &mesh.faces {
        out.write_all(&[3])?;
        out.write_all(&little_endian(*face))?;
    }
    Ok(())
}

fn write_ply_header(mesh: &Mesh, normals: bool, out: &mut dyn Write) -> anyhow::Result<()> {
    let (vertices, faces) = (mesh.vertices.len(), mesh.faces.len());
    writeln!(out, "ply\nformat binary_little_endian 1.0\ncomment dsdf\nelement vertex {vertices}")?;
    let position = if is_far(mesh) { "double" } else { "float" };
    for name in ["x", "y", "z"] {
        writeln!(out, "property {position} {name}")?;
    }
    for name in ["nx", "ny", "nz"].iter().filter(|_| normals) {
        writeln!(out, "property float {name}")?;
    }
    writeln!(out, "element face {faces}\nproperty list uchar int vertex_indices\nend_header")?;
    Ok(())
}

fn write_obj(mesh: &Mesh, out: &mut dyn Write) -> anyhow::Result<()> {
    writeln!(out, "# dsdf")?;
    let normals = mesh.has_normals();
    for v in &mesh.vertices {
        if is_far(mesh) {
            let v = mesh.origin + v.as_dvec3();
            writeln!(out, "v {} {} {}", v.x, v.y, v.z)?;
        } else {
            writeln!(out, "v {} {} {}", v.x, v.y, v.z)?;
        }
    }
    for n in mesh.normals.iter().filter(|_| normals) {
        writeln!(out, "vn {} {} {}", n.x, n.y, n.z)?;
    }
    // OBJ counts vertices from 1.
    for [a, b, c] in mesh.faces.iter().map(|f| f.map(|v| u64::from(v) + 1)) {
        if normals {
            writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
        } else {
            writeln!(out, "f {a} {b} {c}")?;
        }
    }
    Ok(())
}
