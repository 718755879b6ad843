//! Writing of binary glTF files (glTF 2.0, section 4.4: Binary glTF Layout).
//!
//! A file has a header, a JSON chunk and a binary chunk. The JSON chunk describes one mesh of one
//! primitive. The binary chunk holds the positions, then the normals, the colours and the points in
//! the texture if there are any, then the indices, then the image of the texture.

use std::io::{self, Write};

use glam::{DQuat, DVec3, Vec2, Vec3};
use serde_json::{Value, json};

use crate::bytes::little_endian;
use crate::{Export, Mesh};

/// Numbers of the glTF 2.0 specification.
pub(crate) const MAGIC: u32 = 0x4654_6c67;
pub(crate) const VERSION: u32 = 2;
pub(crate) const JSON_CHUNK: u32 = 0x4e4f_534a;
pub(crate) const BINARY_CHUNK: u32 = 0x004e_4942;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
pub(crate) const FLOAT: u32 = 5126;
pub(crate) const UNSIGNED_INT: u32 = 5125;
pub(crate) const UNSIGNED_SHORT: u32 = 5123;

/// The key in the `extras` of the node that turns the mesh upright and scales it. The reader leaves
/// its transformation out, so that it reads positions in world units.
pub(crate) const VIEW_KEY: &str = "dsdf:view";

/// The bytes of the header and of the headers of both chunks.
const HEADER_BYTES: usize = 12 + 8 + 8;

/// The bytes of a position or a normal (three floats), or of a face (three indices).
const TRIPLE_BYTES: usize = 12;

/// The bytes of a colour: four channels of 16 bits. In linear light, 8 bits are too few for dark
/// colours.
const COLOR_BYTES: usize = 8;

/// The bytes of a point in a texture: two floats.
const POINT_BYTES: usize = 8;

/// The parts of a mesh that a file has.
struct Parts<'a> {
    vertices: &'a [Vec3],
    normals: &'a [Vec3],
    colors: &'a [Vec3],
    points: &'a [Vec2],
    faces: &'a [[u32; 3]],
    /// The content of the texture's .png file, padded to words of four bytes.
    image: Vec<u8>,
}

impl Parts<'_> {
    /// The bytes of the binary chunk.
    fn bytes(&self) -> usize {
        let triples = self.vertices.len() + self.normals.len() + self.faces.len();
        let (colors, points) = (COLOR_BYTES * self.colors.len(), POINT_BYTES * self.points.len());
        TRIPLE_BYTES * triples + colors + points + self.image.len()
    }
}

/// Writes the mesh as a .glb file.
pub(crate) fn write_glb(mesh: &Mesh, export: &Export, out: &mut dyn Write) -> io::Result<()> {
    let whole = mesh;
    let split = export.texture.map(|texture| texture.split(whole));
    let mesh = split.as_ref().unwrap_or(whole);
    let image = export.texture.map_or(Ok(Vec::new()), |texture| film::png(&texture.image));
    let mut image = image.map_err(io::Error::other)?;
    image.resize(image.len().next_multiple_of(4), 0);
    let parts = Parts {
        vertices: &mesh.vertices,
        normals: if mesh.has_normals() { &mesh.normals } else { &[] },
        colors: if mesh.has_colors() { &mesh.colors } else { &[] },
        points: export.texture.map_or(&[], |texture| &texture.points),
        faces: &mesh.faces,
        image,
    };
    let mut document = document(&parts);
    add_nodes(&mut document, mesh.origin, export);
    if mesh.has_colors() || export.texture.is_some() {
        add_material(&mut document, !whole.is_closed());
    }
    if export.texture.is_some() {
        add_texture(&mut document, &parts);
    }
    let mut text = serde_json::to_vec(&document)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let binary_bytes = parts.bytes();
    let total = u32::try_from(HEADER_BYTES + text.len() + binary_bytes).map_err(|e| {
        let limit = "a .glb file holds at most 4 GiB; a .ply file has no such limit";
        io::Error::other(format!("{limit}: {e}"))
    })?;
    for word in [MAGIC, VERSION, total, text.len() as u32, JSON_CHUNK] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(&text)?;
    // All data are words of four bytes, so this chunk needs no padding.
    for word in [binary_bytes as u32, BINARY_CHUNK] {
        out.write_all(&word.to_le_bytes())?;
    }
    for v in parts.vertices.iter().chain(parts.normals) {
        out.write_all(&little_endian(v.to_array().map(f32::to_bits)))?;
    }
    for color in parts.colors {
        let channels = color.extend(1.0).to_array();
        for c in channels.map(|c| (c.clamp(0.0, 1.0) * f32::from(u16::MAX)).round() as u16) {
            out.write_all(&c.to_le_bytes())?;
        }
    }
    for point in parts.points {
        point.to_array().iter().try_for_each(|c| out.write_all(&c.to_le_bytes()))?;
    }
    for face in parts.faces {
        out.write_all(&little_endian(*face))?;
    }
    out.write_all(&parts.image)
}

/// The JSON chunk, without nodes.
fn document(parts: &Parts) -> Value {
    let (mut views, mut accessors) = (Vec::new(), Vec::new());
    let mut attributes = serde_json::Map::new();
    let mut offset = 0;
    let mut add = |name: &str, component: u32, count: usize, kind: &str, bytes: usize| {
        if count > 0 {
            attributes.insert(name.to_owned(), json!(accessors.len()));
            accessors.push(accessor(views.len(), component, count, kind));
            views.push(view(offset, bytes, ARRAY_BUFFER));
            offset += bytes;
        }
    };
    let (vertices, normals) = (parts.vertices.len(), parts.normals.len());
    let colors = parts.colors.len();
    add("POSITION", FLOAT, vertices, "VEC3", TRIPLE_BYTES * vertices);
    add("NORMAL", FLOAT, normals, "VEC3", TRIPLE_BYTES * normals);
    add("COLOR_0", UNSIGNED_SHORT, colors, "VEC4", COLOR_BYTES * colors);
    let points = parts.points.len();
    add("TEXCOORD_0", FLOAT, points, "VEC2", POINT_BYTES * points);
    if let Some(positions) = accessors.first_mut() {
        let (low, high) = extent(parts.vertices);
        (positions["min"], positions["max"]) = (json!(low.to_array()), json!(high.to_array()));
    }
    if let Some(position) = attributes.get("COLOR_0").and_then(Value::as_u64) {
        accessors[position as usize]["normalized"] = json!(true);
    }
    accessors.push(accessor(views.len(), UNSIGNED_INT, 3 * parts.faces.len(), "SCALAR"));
    views.push(view(offset, TRIPLE_BYTES * parts.faces.len(), ELEMENT_ARRAY_BUFFER));
    let primitive = json!({"attributes": attributes, "indices": accessors.len() - 1});
    json!({
        "asset": {"version": "2.0", "generator": "dsdf"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": parts.bytes()}],
        "bufferViews": views,
        "accessors": accessors
    })
}

/// Adds the node of the mesh, and above it one that turns it upright and scales it, unless both
/// are as in the world.
fn add_nodes(document: &mut Value, origin: DVec3, export: &Export) {
    let mut node = json!({"mesh": 0});
    if origin != DVec3::ZERO {
        node["translation"] = json!(origin.to_array());
    }
    document["nodes"] = json!([node]);
    if (export.scale, export.up) == (1.0, DVec3::Y) {
        return;
    }
    let rotation = DQuat::from_rotation_arc(export.up, DVec3::Y).normalize();
    let mut extras = serde_json::Map::new();
    extras.insert(VIEW_KEY.to_owned(), json!(true));
    let view = json!({
        "name": "upright",
        "children": [1],
        "rotation": rotation.to_array(),
        "scale": DVec3::splat(export.scale).to_array(),
        "extras": extras
    });
    document["nodes"] = json!([view, node]);
}

/// Adds a material that is as rough as can be: the colours are those that cameras saw.
fn add_material(document: &mut Value, double_sided: bool) {
    document["meshes"][0]["primitives"][0]["material"] = json!(0);
    let factors = json!({"metallicFactor": 0.0, "roughnessFactor": 1.0});
    document["materials"] = json!([{"pbrMetallicRoughness": factors, "doubleSided": double_sided}]);
}

/// Adds the image at the end of the binary chunk as the colours of the material.
fn add_texture(document: &mut Value, parts: &Parts) {
    /// Numbers of the specification: linear interpolation, between levels too, and no repetition.
    const LINEAR: u32 = 9729;
    const LINEAR_MIPMAP_LINEAR: u32 = 9987;
    const CLAMP_TO_EDGE: u32 = 33071;
    document["samplers"] = json!([{
        "magFilter": LINEAR,
        "minFilter": LINEAR_MIPMAP_LINEAR,
        "wrapS": CLAMP_TO_EDGE,
        "wrapT": CLAMP_TO_EDGE
    }]);
    if let Some(views) = document["bufferViews"].as_array_mut() {
        let (offset, bytes) = (parts.bytes() - parts.image.len(), parts.image.len());
        views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes}));
        let last = views.len() - 1;
        document["images"] = json!([{"bufferView": last, "mimeType": "image/png"}]);
    }
    document["textures"] = json!([{"sampler": 0, "source": 0}]);
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": 0});
}

/// A part of the binary chunk: `bytes` from the byte `offset`.
fn view(offset: usize, bytes: usize, target: u32) -> Value {
    json!({
        "buffer": 0,
        "byteOffset": offset,
        "byteLength": bytes,
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
