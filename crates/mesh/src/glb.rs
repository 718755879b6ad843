//! Writing of binary glTF files (glTF 2.0, section 4.4: Binary glTF Layout).
//!
//! A file has a header, a JSON chunk and a binary chunk. The JSON chunk describes one mesh of one
//! primitive. The binary chunk holds the positions, then the normals if there are any, then the
//! indices.

use std::io::Write;

use anyhow::Context;
use glam::{DVec3, Vec3};
use serde_json::{Value, json};

use crate::Mesh;
use crate::bytes::little_endian;

/// Numbers of the glTF 2.0 specification.
const MAGIC: u32 = 0x4654_6c67;
const VERSION: u32 = 2;
const JSON_CHUNK: u32 = 0x4e4f_534a;
const BINARY_CHUNK: u32 = 0x004e_4942;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;

/// The bytes of the header and of the headers of both chunks.
const HEADER_BYTES: usize = 12 + 8 + 8;

/// The bytes of a position or a normal (three floats), or of a face (three indices).
const TRIPLE_BYTES: usize = 12;

/// Writes the mesh as a .glb file.
pub(crate) fn write_glb(mesh: &Mesh, out: &mut dyn Write) -> anyhow::Result<()> {
    let normals = if mesh.has_normals() { &mesh.normals[..] } else { &[] };
    let mut text = serde_json::to_vec(&document(mesh, normals))?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let binary_bytes = TRIPLE_BYTES * (mesh.vertices.len() + normals.len() + mesh.faces.len());
    let total = u32::try_from(HEADER_BYTES + text.len() + binary_bytes)
        .context("a .glb file holds at most 4 GiB; a .ply file has no such limit")?;
    for word in [MAGIC, VERSION, total, text.len() as u32, JSON_CHUNK] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(&text)?;
    // All data are words of four bytes, so this chunk needs no padding.
    for word in [binary_bytes as u32, BINARY_CHUNK] {
        out.write_all(&word.to_le_bytes())?;
    }
    for v in mesh.vertices.iter().chain(normals) {
        out.write_all(&little_endian(v.to_array().map(f32::to_bits)))?;
    }
    for face in &mesh.faces {
        out.write_all(&little_endian(*face))?;
    }
    Ok(())
}

/// The JSON chunk.
fn document(mesh: &Mesh, normals: &[Vec3]) -> Value {
    let (mut views, mut accessors) = (Vec::new(), Vec::new());
    let mut offset = 0;
    for data in [&mesh.vertices[..], normals].into_iter().filter(|d| !d.is_empty()) {
        accessors.push(accessor(views.len(), FLOAT, data.len(), "VEC3"));
        views.push(view(offset, data.len(), ARRAY_BUFFER));
        offset += TRIPLE_BYTES * data.len();
    }
    let mut attributes = json!({"POSITION": 0});
    if accessors.len() > 1 {
        attributes["NORMAL"] = json!(1);
    }
    if let Some(positions) = accessors.first_mut() {
        let (low, high) = extent(&mesh.vertices);
        (positions["min"], positions["max"]) = (json!(low.to_array()), json!(high.to_array()));
    }
    accessors.push(accessor(views.len(), UNSIGNED_INT, 3 * mesh.faces.len(), "SCALAR"));
    views.push(view(offset, mesh.faces.len(), ELEMENT_ARRAY_BUFFER));
    let primitive = json!({"attributes": attributes, "indices": accessors.len() - 1});
    let mut node = json!({"mesh": 0});
    if mesh.origin != DVec3::ZERO {
        node["translation"] = json!(mesh.origin.to_array());
    }
    json!({
        "asset": {"version": "2.0", "generator": "dsdf"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": offset + TRIPLE_BYTES * mesh.faces.len()}],
        "bufferViews": views,
        "accessors": accessors
    })
}

/// A part of the binary chunk: `count` triples from the byte `offset`.
fn view(offset: usize, count: usize, target: u32) -> Value {
    json!({
        "buffer": 0,
        "byteOffset": offset,
        "byteLength": TRIPLE_BYTES * count,
        "target": target
    })
}

/// The type of the data of a view: `count` items of the glTF type `kind`.
fn accessor(view: usize, component: u32, count: usize, kind: &str) -> Value {
    json!({
        "bufferView": view,
        "componentType": component,
        "count": count,
        "type": kind
    })
}

/// The least and the largest coordinates of `points`.
fn extent(points: &[Vec3]) -> (Vec3, Vec3) {
    let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    points.iter().fold(start, |(low, high), v| (low.min(*v), high.max(*v)))
}
