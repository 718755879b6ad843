//! Reading of mesh files: .ply and .obj, and the choice of the reader.

#![warn(clippy::cast_possible_truncation)]

use std::fmt::Display;
use std::path::Path;

use files::{InputError, extension};
use glam::DVec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyDef, PropertyType,
    ScalarType,
};

use crate::Mesh;
use crate::glb_read::parse_glb;
use crate::stl::parse_stl;

/// The formats that are read.
const FORMATS: &str = "a .ply, .obj, .glb or .stl mesh";

/// Reads a mesh from a .ply file (ASCII or binary), an .obj file, a .glb file (binary glTF 2.0) or
/// an .stl file (text or binary).
///
/// A polygon becomes a fan of triangles. Normals are read from .ply, if each vertex has one.
/// Colours, texture coordinates, materials and all other content are ignored. Equal positions of an
/// .stl or a .glb file become one vertex. A .glb file has all triangles of its scene, with the
/// transformations of its nodes; the turn and the factor of [`crate::Export`] are left out, so the
/// positions are in the units of the mesh that was exported.
///
/// # Errors
/// If the file is missing, is damaged, has no faces, or has a vertex that is not finite or an index
/// out of range.
pub fn read_mesh(path: &Path) -> Result<Mesh, InputError> {
    let parse = match extension(path).as_str() {
        "ply" => parse_ply,
        "obj" => parse_obj,
        "glb" => parse_glb,
        "stl" => parse_stl,
        other => {
            let found = format!("extension \"{other}\"");
            return Err(InputError::new(path, "mesh", found, FORMATS));
        }
    };
    let bytes = files::read(path, "mesh", FORMATS)?;
    let mesh = parse(path, &bytes)?;
    check(path, &mesh)?;
    Ok(mesh)
}

/// An error if the mesh has no faces, a vertex that is not finite, or an index out of range.
fn check(path: &Path, mesh: &Mesh) -> Result<(), InputError> {
    if mesh.faces.is_empty() {
        return Err(InputError::new(path, "faces", "none", "one or more"));
    }
    if let Some(i) = mesh.vertices.iter().position(|v| !v.is_finite()) {
        let (field, found) = (format!("vertex {i}"), mesh.vertices[i]);
        return Err(InputError::new(path, field, found, "finite coordinates"));
    }
    let count = mesh.vertices.len();
    if let Some(i) = mesh.faces.iter().position(|f| f.iter().any(|v| *v as usize >= count)) {
        let (field, found) = (format!("triangle {i}"), format!("vertices {:?}", mesh.faces[i]));
        return Err(InputError::new(path, field, found, below(count)));
    }
    Ok(())
}

/// The indices of `count` vertices, in words.
fn below(count: usize) -> String {
    format!("indices from 0 to below {count}")
}

/// The triangles of a polygon, all with its first vertex.
fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    (2..polygon.len()).map(|i| [polygon[0], polygon[i - 1], polygon[i]])
}

/// The properties of a vertex or a face of a PLY file that a mesh needs.
struct Element {
    /// x, y, z, nx, ny, nz; NaN if missing.
    numbers: [f64; 6],
    polygon: Option<Vec<i64>>,
}

impl PropertyAccess for Element {
    fn new() -> Self {
        Element { numbers: [f64::NAN; 6], polygon: None }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if let Some(i) = ["x", "y", "z", "nx", "ny", "nz"].iter().position(|n| *n == name) {
            let Some(value) = number(&property) else {
                return PropertyAccessResult::UnsupportedType;
            };
            self.numbers[i] = value;
        } else if name == "vertex_indices" || name == "vertex_index" {
            let Some(polygon) = indices(property) else {
                return PropertyAccessResult::UnsupportedType;
            };
            self.polygon = Some(polygon);
        } else {
            return PropertyAccessResult::Ignored;
        }
        PropertyAccessResult::Set
    }
}

fn number(property: &Property) -> Option<f64> {
    Some(match property {
        Property::Float(v) => f64::from(*v),
        Property::Double(v) => *v,
        Property::Char(v) => f64::from(*v),
        Property::UChar(v) => f64::from(*v),
        Property::Short(v) => f64::from(*v),
        Property::UShort(v) => f64::from(*v),
        Property::Int(v) => f64::from(*v),
        Property::UInt(v) => f64::from(*v),
        _ => return None,
    })
}

/// A list of indices, which may be negative.
fn indices(property: Property) -> Option<Vec<i64>> {
    fn convert<T: Into<i64> + Copy>(list: &[T]) -> Vec<i64> {
        list.iter().map(|i| (*i).into()).collect()
    }
    Some(match property {
        Property::ListUInt(v) => convert(&v),
        Property::ListInt(v) => convert(&v),
        Property::ListShort(v) => convert(&v),
        Property::ListUShort(v) => convert(&v),
        Property::ListUChar(v) => convert(&v),
        Property::ListChar(v) => convert(&v),
        _ => return None,
    })
}

/// Bytes of memory for each element of a PLY file: it, the room of a list that grows, and the
/// triangle or the vertex of the mesh.
const MEMORY_PER_ELEMENT: u64 = 256;

/// Checks the counts of a PLY header against the `length` bytes that follow it: the parser believes
/// them.
fn check_counts(path: &Path, header: &Header, length: usize) -> Result<(), InputError> {
    let (mut least, mut count) = (0u64, 0u64);
    for element in header.elements.values() {
        let size: u64 = element.properties.values().map(|p| least_size(header, p)).sum();
        let field = format!("element {}", element.name);
        if size == 0 && element.count > 0 {
            let found = format!("{} elements without properties", element.count);
            return Err(InputError::new(path, field, found, "one property or more"));
        }
        least = least.saturating_add(size.saturating_mul(element.count as u64));
        // The last line of a text may lack its end.
        if least > length as u64 + 1 {
            let found = format!("a count of {} in a file with {length} bytes", element.count);
            let expected = "a count that the file has room for, or the whole file";
            return Err(InputError::new(path, field, found, expected));
        }
        count += element.count as u64;
    }
    let memory = count.saturating_mul(MEMORY_PER_ELEMENT);
    files::check_memory(path, "mesh", format!("{count} elements"), memory)
}

/// The fewest bytes of a property: a digit and a blank in text, a list without entries in binary.
fn least_size(header: &Header, property: &PropertyDef) -> u64 {
    let (PropertyType::Scalar(number) | PropertyType::List(number, _)) = &property.data_type;
    match (header.encoding, number) {
        (Encoding::Ascii, _) => 2,
        (_, ScalarType::Char | ScalarType::UChar) => 1,
        (_, ScalarType::Short | ScalarType::UShort) => 2,
        (_, ScalarType::Int | ScalarType::UInt | ScalarType::Float) => 4,
        (_, ScalarType::Double) => 8,
    }
}

pub(crate) fn parse_ply(path: &Path, bytes: &[u8]) -> Result<Mesh, InputError> {
    let error =
        |field: &str, found: &dyn Display| InputError::new(path, field, found, "a PLY file");
    let parser = Parser::<Element>::new();
    let mut reader = Reader::new(bytes);
    let header = parser.read_header(&mut reader).map_err(|e| error("mesh", &e))?;
    check_counts(path, &header, reader.get_ref().len())?;
    let mut payload = parser.read_payload(&mut reader, &header).map_err(|e| error("mesh", &e))?;
    let vertices = payload.swap_remove("vertex").unwrap_or_default();
    let vectors = |start: usize| -> Vec<DVec3> {
        vertices.iter().map(|e| DVec3::from_slice(&e.numbers[start..start + 3])).collect()
    };
    let mut mesh = Mesh::of_vertices(&vectors(0));
    let normals = vectors(3);
    if normals.iter().all(|n| n.is_finite()) {
        mesh.normals = normals.iter().map(|n| n.as_vec3()).collect();
    }
    let count = vertices.len();
    for (i, face) in payload.swap_remove("face").unwrap_or_default().iter().enumerate() {
        let field = || format!("face {i}");
        let polygon = face.polygon.as_ref();
        let polygon = polygon.ok_or_else(|| error(&field(), &"no vertex_indices"))?;
        let index = |v: &i64| {
            let negative = |_| InputError::new(path, field(), format!("index {v}"), below(count));
            u32::try_from(*v).map_err(negative)
        };
        let polygon: Vec<u32> = polygon.iter().map(index).collect::<Result<_, _>>()?;
        mesh.faces.extend(fan(&polygon));
    }
    Ok(mesh)
}

fn parse_obj(path: &Path, bytes: &[u8]) -> Result<Mesh, InputError> {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for (i, line) in bytes.split(|b| *b == b'\n').enumerate() {
        let line = String::from_utf8_lossy(line);
        parse_obj_line(&line, &mut vertices, &mut faces).map_err(|expected| {
            InputError::new(path, format!("line {}", i + 1), line.trim(), expected)
        })?;
    }
    Ok(Mesh { faces, ..Mesh::of_vertices(&vertices) })
}

/// Adds the vertex or the face of a line of an OBJ file. The error is a description of a correct
/// line.
fn parse_obj_line(
    line: &str,
    vertices: &mut Vec<DVec3>,
    faces: &mut Vec<[u32; 3]>,
) -> Result<(), &'static str> {
    let mut words = line.split('#').next().unwrap_or("").split_whitespace();
    match words.next() {
        Some("v") => {
            let numbers: Vec<f64> = words.map_while(|w| w.parse().ok()).collect();
            let position = numbers.get(..3).ok_or("v and three coordinates")?;
            vertices.push(DVec3::from_slice(position));
        }
        Some("f") => {
            let polygon: Option<Vec<u32>> = words.map(|w| obj_index(w, vertices.len())).collect();
            let polygon = polygon
                .filter(|p| p.len() > 2)
                .ok_or("f and three or more corners, each with the number of an existing vertex")?;
            faces.extend(fan(&polygon));
        }
        _ => {}
    }
    Ok(())
}

/// The index of the vertex of a corner of an OBJ face: `v`, `v/vt`, `v//vn` or `v/vt/vn`.
///
/// Numbers count from 1, or backwards from −1, the latest of the `vertices` vertices so far. `None`
/// if there is no such number. An index may be too large: a vertex may follow its faces in the
/// file, so `check` tests the range at the end.
fn obj_index(word: &str, vertices: usize) -> Option<u32> {
    let number: i64 = word.split('/').next()?.parse().ok()?;
    let index = if number < 0 { number.checked_add(vertices as i64)? } else { number - 1 };
    u32::try_from(index).ok()
}
