//! Mesh files: .ply, .obj and .glb out, .ply and .obj in.

use std::fmt::Write as _;
use std::io::{BufReader, Write};
use std::path::Path;

use glam::Vec3;
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};
use serde_json::json;

use super::Mesh;
use crate::error::InputError;
use crate::io::atomic_write;

fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase()
}

/// Writes a mesh by its extension: .ply (binary), .obj or .glb.
///
/// # Errors
/// If the extension is another one, or the file cannot be written.
pub fn write_mesh(path: &Path, mesh: &Mesh) -> anyhow::Result<()> {
    let bytes = match extension(path).as_str() {
        "ply" => ply(mesh),
        "obj" => obj(mesh)?.into_bytes(),
        "glb" => glb(mesh)?,
        other => {
            return Err(InputError::new(path, "output", format!("extension \"{other}\""), ".ply, .obj or .glb").into());
        }
    };
    atomic_write(path, |out| Ok(out.write_all(&bytes)?))
}

fn has_normals(mesh: &Mesh) -> bool {
    mesh.normals.len() == mesh.vertices.len()
}

fn ply(mesh: &Mesh) -> Vec<u8> {
    let normals = has_normals(mesh);
    let names = if normals { "x y z nx ny nz" } else { "x y z" };
    let properties: String = names.split(' ').fold(String::new(), |s, n| s + "property float " + n + "\n");
    let mut out = format!(
        "ply\nformat binary_little_endian 1.0\ncomment dsdf\nelement vertex {}\n{properties}element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.vertices.len(),
        mesh.faces.len()
    )
    .into_bytes();
    for (i, v) in mesh.vertices.iter().enumerate() {
        v.to_array().iter().for_each(|c| out.extend(c.to_le_bytes()));
        if normals {
            mesh.normals[i].to_array().iter().for_each(|c| out.extend(c.to_le_bytes()));
        }
    }
    for face in &mesh.faces {
        out.push(3);
        face.iter().for_each(|v| out.extend(v.to_le_bytes()));
    }
    out
}

fn obj(mesh: &Mesh) -> Result<String, std::fmt::Error> {
    let mut out = String::from("# dsdf\n");
    for v in &mesh.vertices {
        writeln!(out, "v {} {} {}", v.x, v.y, v.z)?;
    }
    for n in &mesh.normals {
        writeln!(out, "vn {} {} {}", n.x, n.y, n.z)?;
    }
    for face in &mesh.faces {
        let corner = |v: u32| if has_normals(mesh) { format!("{0}//{0}", v + 1) } else { (v + 1).to_string() };
        writeln!(out, "f {} {} {}", corner(face[0]), corner(face[1]), corner(face[2]))?;
    }
    Ok(out)
}

/// A binary glTF 2.0 file with one mesh: header, JSON chunk, binary chunk.
fn glb(mesh: &Mesh) -> anyhow::Result<Vec<u8>> {
    let mut data: Vec<u8> = bytemuck::cast_slice(&mesh.vertices).to_vec();
    let positions = data.len();
    data.extend(bytemuck::cast_slice::<Vec3, u8>(&mesh.normals));
    let normals = data.len() - positions;
    data.extend(bytemuck::cast_slice::<u32, u8>(mesh.faces.as_flattened()));
    let indices = data.len() - positions - normals;
    let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (low, high) = mesh.vertices.iter().fold(start, |(l, h), v| (l.min(*v), h.max(*v)));
    let count = mesh.vertices.len();
    let text = json!({
        "asset": {"version": "2.0", "generator": "dsdf"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}]}],
        "buffers": [{"byteLength": data.len()}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": positions, "target": 34962},
            {"buffer": 0, "byteOffset": positions, "byteLength": normals, "target": 34962},
            {"buffer": 0, "byteOffset": positions + normals, "byteLength": indices, "target": 34963}
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", "min": low.to_array(), "max": high.to_array()},
            {"bufferView": 1, "componentType": 5126, "count": count, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5125, "count": 3 * mesh.faces.len(), "type": "SCALAR"}
        ]
    });
    let mut text = serde_json::to_vec(&text)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    data.resize(data.len().next_multiple_of(4), 0);
    let mut out = Vec::with_capacity(28 + text.len() + data.len());
    let total = (28 + text.len() + data.len()) as u32;
    for word in [0x4654_6c67, 2, total, text.len() as u32, 0x4e4f_534a] {
        out.write_all(&u32::to_le_bytes(word))?;
    }
    out.write_all(&text)?;
    for word in [data.len() as u32, 0x004e_4942] {
        out.write_all(&u32::to_le_bytes(word))?;
    }
    out.write_all(&data)?;
    Ok(out)
}

/// Reads a mesh, .ply or .obj; polygons become fans of triangles.
///
/// # Errors
/// If the file is missing, damaged, without faces, or has a vertex that is not finite or an index out of range.
pub fn read_mesh(path: &Path) -> Result<Mesh, InputError> {
    let mesh = match extension(path).as_str() {
        "ply" => read_ply(path)?,
        "obj" => read_obj(path)?,
        other => return Err(InputError::new(path, "mesh", format!("extension \"{other}\""), ".ply or .obj")),
    };
    if let Some(i) = mesh.vertices.iter().position(|v| !v.is_finite()) {
        return Err(InputError::new(path, format!("vertex {i}"), mesh.vertices[i], "finite coordinates"));
    }
    let count = mesh.vertices.len();
    if let Some(i) = mesh.faces.iter().position(|f| f.iter().any(|v| *v as usize >= count)) {
        return Err(InputError::new(
            path,
            format!("face {i}"),
            format!("{:?}", mesh.faces[i]),
            format!("indices below {count}"),
        ));
    }
    if mesh.faces.is_empty() {
        return Err(InputError::new(path, "faces", "none", "a surface"));
    }
    Ok(mesh)
}

fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    (2..polygon.len()).map(|i| [polygon[0], polygon[i - 1], polygon[i]])
}

fn read_ply(path: &Path) -> Result<Mesh, InputError> {
    let error = |e: &dyn std::fmt::Display| InputError::new(path, "mesh", e, "a PLY mesh");
    let file = std::fs::File::open(path).map_err(|e| error(&e))?;
    let ply = Parser::<DefaultElement>::new().read_ply(&mut BufReader::new(file)).map_err(|e| error(&e))?;
    let element = |name: &str| ply.payload.get(name).map_or(&[][..], Vec::as_slice);
    let mut mesh = Mesh::default();
    for vertex in element("vertex") {
        let c = ["x", "y", "z"].map(|c| vertex.get(c).and_then(number).unwrap_or(f32::NAN));
        mesh.vertices.push(c.into());
    }
    for face in element("face") {
        let list = face.get("vertex_indices").or(face.get("vertex_index")).and_then(indices);
        let list = list.ok_or_else(|| error(&"a face without vertex_indices"))?;
        mesh.faces.extend(fan(&list));
    }
    Ok(mesh)
}

fn number(property: &Property) -> Option<f32> {
    match property {
        Property::Float(v) => Some(*v),
        Property::Double(v) => Some(*v as f32),
        _ => None,
    }
}

/// A negative index becomes one that is out of range.
fn indices(property: &Property) -> Option<Vec<u32>> {
    let signed = |v: i64| u32::try_from(v).unwrap_or(u32::MAX);
    Some(match property {
        Property::ListInt(v) => v.iter().map(|i| signed((*i).into())).collect(),
        Property::ListUInt(v) => v.clone(),
        Property::ListShort(v) => v.iter().map(|i| signed((*i).into())).collect(),
        Property::ListUShort(v) => v.iter().map(|i| u32::from(*i)).collect(),
        Property::ListUChar(v) => v.iter().map(|i| u32::from(*i)).collect(),
        Property::ListChar(v) => v.iter().map(|i| signed((*i).into())).collect(),
        _ => return None,
    })
}

fn read_obj(path: &Path) -> Result<Mesh, InputError> {
    let options = tobj::LoadOptions { triangulate: true, single_index: false, ..tobj::LoadOptions::default() };
    let (models, _) = tobj::load_obj(path, &options).map_err(|e| InputError::new(path, "mesh", e, "an OBJ mesh"))?;
    let mut mesh = Mesh::default();
    for model in models {
        let start = mesh.vertices.len() as u32;
        mesh.vertices.extend(model.mesh.positions.chunks_exact(3).map(Vec3::from_slice));
        mesh.faces.extend(model.mesh.indices.chunks_exact(3).map(|f| [f[0] + start, f[1] + start, f[2] + start]));
    }
    Ok(mesh)
}
