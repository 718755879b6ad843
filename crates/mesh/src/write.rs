//! Mesh files out: .ply, .obj and .glb.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use glam::Vec3;
use serde_json::json;

use super::{Mesh, extension};
use io::InputError;
use io::atomic_write;

/// Writes a mesh by its extension: .ply (binary, little endian), .obj or .glb (binary glTF 2.0).
/// The file appears whole or not at all.
///
/// # Errors
/// If the extension is another one, or the file cannot be written.
pub fn write_mesh(path: &Path, mesh: &Mesh) -> anyhow::Result<()> {
    let write: fn(&Mesh, &mut dyn Write) -> anyhow::Result<()> = match extension(path).as_str() {
        "ply" => ply,
        "obj" => obj,
        "glb" => glb,
        other => {
            return Err(InputError::new(
                path,
                "output",
                format!("extension \"{other}\""),
                ".ply, .obj or .glb",
            )
            .into());
        }
    };
    atomic_write(path, |out| write(mesh, out))
}

fn has_normals(mesh: &Mesh) -> bool {
    !mesh.normals.is_empty() && mesh.normals.len() == mesh.vertices.len()
}

fn ply(mesh: &Mesh, out: &mut dyn Write) -> anyhow::Result<()> {
    let normals = has_normals(mesh);
    writeln!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment dsdf\nelement vertex {}",
        mesh.vertices.len()
    )?;
    for name in ["x", "y", "z", "nx", "ny", "nz"].iter().take(if normals { 6 } else { 3 }) {
        writeln!(out, "property float {name}")?;
    }
    writeln!(
        out,
        "element face {}\nproperty list uchar int vertex_indices\nend_header",
        mesh.faces.len()
    )?;
    for (i, v) in mesh.vertices.iter().enumerate() {
        out.write_all(&little_endian(v.to_array().map(f32::to_bits)))?;
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

fn little_endian(words: [u32; 3]) -> [u8; 12] {
    let mut bytes = [0; 12];
    bytes.chunks_exact_mut(4).zip(words).for_each(|(b, w)| b.copy_from_slice(&w.to_le_bytes()));
    bytes
}

fn obj(mesh: &Mesh, out: &mut dyn Write) -> anyhow::Result<()> {
    writeln!(out, "# dsdf")?;
    let normals = has_normals(mesh);
    for v in &mesh.vertices {
        writeln!(out, "v {} {} {}", v.x, v.y, v.z)?;
    }
    for n in mesh.normals.iter().filter(|_| normals) {
        writeln!(out, "vn {} {} {}", n.x, n.y, n.z)?;
    }
    for [a, b, c] in mesh.faces.iter().map(|f| f.map(|v| u64::from(v) + 1)) {
        if normals {
            writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
        } else {
            writeln!(out, "f {a} {b} {c}")?;
        }
    }
    Ok(())
}

/// The numbers that glTF 2.0 has for things.
mod gltf {
    pub(super) const MAGIC: u32 = 0x4654_6c67;
    pub(super) const JSON_CHUNK: u32 = 0x4e4f_534a;
    pub(super) const BINARY_CHUNK: u32 = 0x004e_4942;
    pub(super) const ARRAY_BUFFER: u32 = 34962;
    pub(super) const ELEMENT_ARRAY_BUFFER: u32 = 34963;
    pub(super) const FLOAT: u32 = 5126;
    pub(super) const UNSIGNED_INT: u32 = 5125;
}

/// One mesh of one primitive: header, JSON chunk, binary chunk (positions, normals if any,
/// indices).
fn glb(mesh: &Mesh, out: &mut dyn Write) -> anyhow::Result<()> {
    let (count, normals) =
        (mesh.vertices.len(), if has_normals(mesh) { &mesh.normals[..] } else { &[] });
    let vectors = [&mesh.vertices[..], normals];
    let indices = 12 * mesh.faces.len();
    let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (low, high) = mesh.vertices.iter().fold(start, |(l, h), v| (l.min(*v), h.max(*v)));
    let (mut views, mut accessors, mut attributes) =
        (Vec::new(), Vec::new(), json!({"POSITION": 0}));
    for (view, data) in vectors.iter().enumerate().filter(|(_, d)| !d.is_empty()) {
        views.push(json!({"buffer": 0, "byteOffset": 12 * count * view, "byteLength": 12 * count, "target": gltf::ARRAY_BUFFER}));
        accessors.push(json!({"bufferView": view, "componentType": gltf::FLOAT, "count": data.len(), "type": "VEC3"}));
    }
    if accessors.len() > 1 {
        attributes["NORMAL"] = json!(1);
    }
    if let Some(positions) = accessors.first_mut() {
        (positions["min"], positions["max"]) = (json!(low.to_array()), json!(high.to_array()));
    }
    let offset = 12 * count * views.len();
    accessors.push(json!({"bufferView": views.len(), "componentType": gltf::UNSIGNED_INT, "count": 3 * mesh.faces.len(), "type": "SCALAR"}));
    views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": indices, "target": gltf::ELEMENT_ARRAY_BUFFER}));
    let length = offset + indices;
    let primitive = json!({"attributes": attributes, "indices": accessors.len() - 1});
    let mut text = serde_json::to_vec(&json!({
        "asset": {"version": "2.0", "generator": "dsdf"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": length}],
        "bufferViews": views,
        "accessors": accessors
    }))?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = u32::try_from(28 + text.len() + length)
        .context("a .glb file holds 4 GiB at most; .ply has no limit")?;
    for word in [gltf::MAGIC, 2, total, text.len() as u32, gltf::JSON_CHUNK] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(&text)?;
    // All data are words of four bytes, so the chunk needs no padding.
    for word in [length as u32, gltf::BINARY_CHUNK] {
        out.write_all(&word.to_le_bytes())?;
    }
    for v in vectors.into_iter().flatten() {
        out.write_all(&little_endian(v.to_array().map(f32::to_bits)))?;
    }
    for face in &mesh.faces {
        out.write_all(&little_endian(*face))?;
    }
    Ok(())
}
