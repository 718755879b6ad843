//! Writing of mesh files: .ply, .obj, .glb and .stl.

use std::io::Write;
use std::path::Path;

use film::srgb_encode;
use glam::{DVec3, Vec3};
use io::{InputError, atomic_write};

use crate::bytes::little_endian;
use crate::glb::write_glb;
use crate::stl::write_stl;
use crate::{Mesh, extension};

/// The size and the direction of a mesh in a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Export {
    /// The factor on all lengths, finite and above 0.
    pub scale: f64,
    /// The direction that a .glb file shows upwards: a unit vector in the coordinates of the mesh.
    /// Files in other formats keep the axes of the mesh.
    pub up: DVec3,
}

impl Default for Export {
    /// The mesh as it is: the factor 1, and the upward direction of glTF, which is y.
    fn default() -> Self {
        Export { scale: 1.0, up: DVec3::Y }
    }
}

/// Writes a mesh as it is: [`export_mesh`] with the default [`Export`].
///
/// # Errors
/// As of [`export_mesh`].
pub fn write_mesh(path: &Path, mesh: &Mesh) -> anyhow::Result<()> {
    export_mesh(path, mesh, &Export::default())
}

/// Writes a mesh in the format of its extension: .ply (binary, little endian), .obj, .glb (binary
/// glTF 2.0) or .stl (binary). A file at `path` is replaced whole.
///
/// Positions are in world units times the factor. A mesh with an origin of its own has them in
/// double precision; a .glb has the origin as the translation of its node. Normals and colours are
/// written if each vertex has one, but not to .stl. Colours are sRGB in .ply (bytes) and .obj (0 to
/// 1, after the position), and linear in .glb, as other programs read them.
///
/// # Errors
/// An [`InputError`] if the extension is another one, the folder does not accept files, or the mesh
/// is too far from the world's origin for .stl. Other errors if the file cannot be written, or is a
/// .glb of more than 4 GiB.
pub fn export_mesh(path: &Path, mesh: &Mesh, export: &Export) -> anyhow::Result<()> {
    let write: fn(&Mesh, &mut dyn Write) -> anyhow::Result<()> = match extension(path).as_str() {
        "ply" => write_ply,
        "obj" => write_obj,
        "glb" => return atomic_write(path, |out| write_glb(mesh, export, out)),
        "stl" => write_stl,
        other => {
            let found = format!("extension \"{other}\"");
            return Err(InputError::new(path, "output", found, ".ply, .obj, .glb or .stl").into());
        }
    };
    if extension(path) == "stl" && is_far(mesh) {
        let found = format!("a mesh around {}, far from 0 for its size", mesh.origin);
        let expected = ".ply, .obj or .glb: .stl has single precision";
        return Err(InputError::new(path, "output", found, expected).into());
    }
    let scaled = mesh.clone().scaled(export.scale);
    atomic_write(path, |out| write(&scaled, out))
}

/// Whether positions need double precision.
fn is_far(mesh: &Mesh) -> bool {
    mesh.origin != DVec3::ZERO
}

/// The sRGB values of a colour, 0 to 1.
fn srgb(color: Vec3) -> [f32; 3] {
    color.to_array().map(|c| srgb_encode(c.clamp(0.0, 1.0)).clamp(0.0, 1.0))
}

fn write_ply(mesh: &Mesh, out: &mut dyn Write) -> anyhow::Result<()> {
    let (normals, colors) = (mesh.has_normals(), mesh.has_colors());
    write_ply_header(mesh, out)?;
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
        if colors {
            out.write_all(&srgb(mesh.colors[i]).map(|c| (c * 255.0).round() as u8))?;
        }
    }
    for face in &mesh.faces {
        out.write_all(&[3])?;
        out.write_all(&little_endian(*face))?;
    }
    Ok(())
}

fn write_ply_header(mesh: &Mesh, out: &mut dyn Write) -> anyhow::Result<()> {
    let (vertices, faces) = (mesh.vertices.len(), mesh.faces.len());
    writeln!(out, "ply\nformat binary_little_endian 1.0\ncomment dsdf\nelement vertex {vertices}")?;
    let position = if is_far(mesh) { "double" } else { "float" };
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

fn write_obj(mesh: &Mesh, out: &mut dyn Write) -> anyhow::Result<()> {
    writeln!(out, "# dsdf")?;
    let (normals, colors) = (mesh.has_normals(), mesh.has_colors());
    for (i, v) in mesh.vertices.iter().enumerate() {
        if is_far(mesh) {
            let v = mesh.origin + v.as_dvec3();
            write!(out, "v {} {} {}", v.x, v.y, v.z)?;
        } else {
            write!(out, "v {} {} {}", v.x, v.y, v.z)?;
        }
        if colors {
            let [r, g, b] = srgb(mesh.colors[i]);
            write!(out, " {r:.4} {g:.4} {b:.4}")?;
        }
        writeln!(out)?;
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
