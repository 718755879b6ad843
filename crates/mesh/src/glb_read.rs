//! Reading of binary glTF files: the triangles of a scene, in world units.

#![warn(clippy::cast_possible_truncation)]

use std::path::Path;

use files::InputError;
use glam::{DMat4, DQuat, DVec3};
use rustc_hash::FxHashMap;
use serde::Deserialize;

use crate::Mesh;
use crate::glb::{
    BINARY_CHUNK, FLOAT, JSON_CHUNK, MAGIC, UNSIGNED_INT, UNSIGNED_SHORT, VERSION, VIEW_KEY,
};

type Result<T> = std::result::Result<T, InputError>;

/// The parts of the JSON chunk that positions and faces need.
#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
struct Document {
    scene: usize,
    scenes: Vec<Scene>,
    nodes: Vec<Node>,
    meshes: Vec<MeshEntry>,
    accessors: Vec<Accessor>,
    buffer_views: Vec<View>,
    extensions_required: Vec<String>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Scene {
    nodes: Vec<usize>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Node {
    children: Vec<usize>,
    mesh: Option<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
    extras: serde_json::Value,
}

#[derive(Deserialize)]
struct MeshEntry {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    attributes: Attributes,
    indices: Option<usize>,
    mode: Option<u32>,
}

#[derive(Deserialize)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: usize,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    count: usize,
    #[serde(rename = "type")]
    kind: String,
    sparse: Option<serde_json::Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    #[serde(default)]
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

/// The mode of a primitive of separate triangles.
const TRIANGLES: u32 = 4;
const UNSIGNED_BYTE: u32 = 5121;

/// Bytes of memory for a vertex or an index while a file is read.
const MEMORY_PER_ITEM: u64 = 96;

/// Reads the triangles of the scene of a .glb file. Equal positions become one vertex. The
/// transformation of a node that dsdf added to turn and scale the mesh is left out.
pub(crate) fn parse_glb(path: &Path, bytes: &[u8]) -> Result<Mesh> {
    let (text, binary) = chunks(path, bytes)?;
    let document: Document = serde_json::from_slice(text)
        .map_err(|e| InputError::new(path, "JSON chunk", e, "a glTF document"))?;
    if let Some(extension) = document.extensions_required.first() {
        let expected = "a file that needs no extension";
        return Err(InputError::new(path, "extensionsRequired", extension, expected));
    }
    let reader = Reader { path, document: &document, binary };
    let placed = reader.placed_meshes()?;
    reader.check_memory(&placed)?;
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for (mesh, place) in placed {
        for primitive in &document.meshes[mesh].primitives {
            reader.add(primitive, &place, &mut vertices, &mut faces)?;
        }
    }
    let vertices = merge_equal(&vertices, &mut faces);
    Ok(Mesh { faces, ..Mesh::of_vertices(&vertices) })
}

/// The distinct positions of `vertices`; `faces` then have their indices.
fn merge_equal(vertices: &[DVec3], faces: &mut [[u32; 3]]) -> Vec<DVec3> {
    let (mut distinct, mut index_of) = (Vec::new(), FxHashMap::default());
    #[expect(clippy::cast_possible_truncation, reason = "faces number all vertices by u32")]
    let merged: Vec<u32> = vertices
        .iter()
        .map(|v| {
            // The sum with 0 makes −0 equal to 0.
            *index_of.entry((*v + 0.0).to_array().map(f64::to_bits)).or_insert_with(|| {
                distinct.push(*v);
                distinct.len() as u32 - 1
            })
        })
        .collect();
    faces.as_flattened_mut().iter_mut().for_each(|v| *v = merged[*v as usize]);
    distinct
}

/// The JSON chunk and the binary chunk, which may be missing.
fn chunks<'a>(path: &Path, bytes: &'a [u8]) -> Result<(&'a [u8], &'a [u8])> {
    let word = |at: usize| {
        let bytes = bytes.get(at..at + 4).and_then(|b| b.try_into().ok());
        bytes.map(u32::from_le_bytes)
    };
    if (word(0), word(4)) != (Some(MAGIC), Some(VERSION)) {
        return Err(InputError::new(path, "mesh", "another header", "a binary glTF 2.0 file"));
    }
    let chunk = |at: usize, kind: u32| {
        let length = word(at)? as usize;
        let data = bytes.get(at + 8..)?.get(..length)?;
        (word(at + 4)? == kind).then_some(data)
    };
    let expected = "the whole of a binary glTF 2.0 file";
    let text = chunk(12, JSON_CHUNK)
        .ok_or_else(|| InputError::new(path, "JSON chunk", "none", expected))?;
    let next = 20 + text.len();
    let binary = match word(next) {
        None => &[],
        Some(_) => chunk(next, BINARY_CHUNK)
            .ok_or_else(|| InputError::new(path, "binary chunk", "none", expected))?,
    };
    Ok((text, binary))
}

impl Node {
    /// The map from the coordinates of the node to those of its parent.
    fn transformation(&self) -> DMat4 {
        if self.extras.get(VIEW_KEY).is_some() {
            return DMat4::IDENTITY;
        }
        self.matrix.map_or_else(
            || {
                DMat4::from_scale_rotation_translation(
                    self.scale.map_or(DVec3::ONE, DVec3::from),
                    self.rotation.map_or(DQuat::IDENTITY, DQuat::from_array),
                    self.translation.map_or(DVec3::ZERO, DVec3::from),
                )
            },
            |m| DMat4::from_cols_array(&m),
        )
    }
}

/// A document with its binary chunk.
struct Reader<'a> {
    path: &'a Path,
    document: &'a Document,
    binary: &'a [u8],
}

impl<'a> Reader<'a> {
    fn error(&self, field: &str, found: impl std::fmt::Display, expected: &str) -> InputError {
        InputError::new(self.path, field, found, expected)
    }

    /// The meshes of the scene, each with its map to the world. A file without scenes has its
    /// meshes in world units.
    fn placed_meshes(&self) -> Result<Vec<(usize, DMat4)>> {
        let document = self.document;
        if document.scenes.is_empty() && document.nodes.is_empty() {
            return Ok((0..document.meshes.len()).map(|i| (i, DMat4::IDENTITY)).collect());
        }
        let missing = |kind: &str, i: usize| {
            self.error(kind, format!("number {i}, which is missing"), "a number in the file")
        };
        let scene =
            document.scenes.get(document.scene).ok_or_else(|| missing("scene", document.scene))?;
        let mut open: Vec<(usize, DMat4)> =
            scene.nodes.iter().rev().map(|node| (*node, DMat4::IDENTITY)).collect();
        let mut is_visited = vec![false; document.nodes.len()];
        let mut placed = Vec::new();
        while let Some((i, parent)) = open.pop() {
            let node = document.nodes.get(i).ok_or_else(|| missing("node", i))?;
            if std::mem::replace(&mut is_visited[i], true) {
                return Err(self.error("node", format!("{i} twice"), "a tree of nodes"));
            }
            let place = parent * node.transformation();
            if let Some(mesh) = node.mesh {
                document.meshes.get(mesh).ok_or_else(|| missing("mesh", mesh))?;
                placed.push((mesh, place));
            }
            open.extend(node.children.iter().rev().map(|child| (*child, place)));
        }
        Ok(placed)
    }

    /// Refuses meshes that need more memory than there is: many nodes may have the same mesh.
    fn check_memory(&self, placed: &[(usize, DMat4)]) -> Result<()> {
        let count = |accessor: usize| self.document.accessors.get(accessor).map_or(0, |a| a.count);
        let of_primitive = |p: &Primitive| {
            let vertices = count(p.attributes.position);
            (vertices as u64).saturating_add(p.indices.map_or(vertices, count) as u64)
        };
        let items = placed
            .iter()
            .flat_map(|(mesh, _)| self.document.meshes[*mesh].primitives.iter())
            .fold(0u64, |sum, p| sum.saturating_add(of_primitive(p)));
        let bytes = items.saturating_mul(MEMORY_PER_ITEM);
        files::check_memory(self.path, "mesh", format!("{items} vertices and indices"), bytes)
    }

    /// Adds the triangles of a primitive.
    fn add(
        &self,
        primitive: &Primitive,
        place: &DMat4,
        vertices: &mut Vec<DVec3>,
        faces: &mut Vec<[u32; 3]>,
    ) -> Result<()> {
        let mode = primitive.mode.unwrap_or(TRIANGLES);
        if mode != TRIANGLES {
            return Err(self.error("mode", mode, "4: separate triangles"));
        }
        let number = |count: usize| {
            u32::try_from(count).map_err(|_| self.error("vertices", count, "fewer than 2^32"))
        };
        let first = number(vertices.len())?;
        let positions = self.items(primitive.attributes.position, "VEC3", &[FLOAT])?;
        vertices.extend(positions.map(|item| {
            let coordinate = |i: usize| {
                let bytes = item[4 * i..4 * i + 4].try_into().unwrap_or_default();
                f64::from(f32::from_le_bytes(bytes))
            };
            place.transform_point3(DVec3::new(coordinate(0), coordinate(1), coordinate(2)))
        }));
        let count = number(vertices.len())? - first;
        let mut corners: Vec<u32> = match primitive.indices {
            None => (0..count).collect(),
            Some(accessor) => {
                let kinds = [UNSIGNED_BYTE, UNSIGNED_SHORT, UNSIGNED_INT];
                let item = |item: &[u8]| {
                    item.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte))
                };
                self.items(accessor, "SCALAR", &kinds)?.map(item).collect()
            }
        };
        if let Some(i) = corners.iter().position(|v| *v >= count) {
            let field = format!("index {i}");
            return Err(self.error(&field, corners[i], &format!("less than {count}")));
        }
        if !corners.len().is_multiple_of(3) {
            return Err(self.error("indices", corners.len(), "three for each triangle"));
        }
        if place.determinant() < 0.0 {
            corners.chunks_exact_mut(3).for_each(|f| f.swap(1, 2));
        }
        faces.extend(corners.chunks_exact(3).map(|f| [first + f[0], first + f[1], first + f[2]]));
        Ok(())
    }

    /// The bytes of each item of an accessor, which must be of the type `kind` with one of the
    /// types `components`.
    fn items(
        &self,
        accessor: usize,
        kind: &str,
        components: &[u32],
    ) -> Result<impl Iterator<Item = &'a [u8]> + use<'a>> {
        let field = format!("accessor {accessor}");
        let document = self.document;
        let wrong = |found: &str, expected: &str| self.error(&field, found, expected);
        let a = document.accessors.get(accessor).ok_or_else(|| wrong("none", "one in the file"))?;
        if a.kind != kind || !components.contains(&a.component_type) {
            let found = format!("{} of type {}", a.kind, a.component_type);
            return Err(wrong(&found, &format!("{kind} of one of the types {components:?}")));
        }
        if a.sparse.is_some() {
            return Err(wrong("sparse data", "dense data"));
        }
        let view = a.buffer_view.and_then(|i| document.buffer_views.get(i));
        let view = view.filter(|view| view.buffer == 0);
        let view = view.ok_or_else(|| wrong("no view", "a view of the binary chunk"))?;
        let width = match a.component_type {
            UNSIGNED_BYTE => 1,
            UNSIGNED_SHORT => 2,
            _ => 4,
        };
        let size = if kind == "VEC3" { 3 * width } else { width };
        let stride = view.byte_stride.unwrap_or(size);
        let data = self.binary.get(view.byte_offset..).and_then(|d| d.get(..view.byte_length));
        let data = data.and_then(|data| data.get(a.byte_offset..)).unwrap_or(&[]);
        let needed = a.count.saturating_sub(1).saturating_mul(stride).saturating_add(size);
        if stride < size || (a.count > 0 && needed > data.len()) {
            let found = format!("{} items every {stride} bytes in {}", a.count, data.len());
            return Err(wrong(&found, "items inside their view, and the view inside the file"));
        }
        Ok((0..a.count).map(move |i| &data[i * stride..i * stride + size]))
    }
}
