//! Meshes: PLY and OBJ.

use std::fmt::Write;

use proptest::prelude::*;

use crate::case::Case;
use crate::layout::Layout;
use crate::lines::Lines;
use crate::spoil::{Spoil, sometimes_spoiled, spoiled};

/// A PLY file: a header of lines, and a body of lines or of binary fields.
#[derive(Clone, Debug)]
struct Ply {
    header: Lines,
    text: Option<Lines>,
    binary: Layout,
}

impl Ply {
    fn to_bytes(&self) -> Vec<u8> {
        let body = self.text.as_ref().map_or_else(|| self.binary.to_bytes(), Lines::to_bytes);
        [self.header.to_bytes(), body].concat()
    }
}

impl Spoil for Ply {
    fn spoil(&mut self, place: usize, harm: usize) {
        match &mut self.text {
            _ if !place.is_multiple_of(3) => self.header.spoil(place / 3, harm),
            Some(text) => text.spoil(place / 3, harm),
            None => self.binary.spoil(place / 3, harm),
        }
    }
}

/// The elements of a PLY file.
#[derive(Clone, Debug)]
struct Elements {
    vertices: usize,
    faces: usize,
    format: &'static str,
    normals: bool,
    /// The types of the length and of the items of a face's list, with their bytes.
    list: [(&'static str, usize); 2],
    /// The count of an element without properties.
    empty: Option<u64>,
}

fn ply(elements: &Elements) -> Ply {
    let Elements { vertices, faces, format, normals, list, empty } = elements;
    let mut header = format!("ply\nformat {format} 1.0\ncomment \u{1b}[31m\n");
    if let Some(count) = empty {
        let _ = writeln!(header, "element material {count}");
    }
    let _ = writeln!(header, "element vertex {vertices}");
    let names = if *normals { &["x", "y", "z", "nx", "ny", "nz"][..] } else { &["x", "y", "z"] };
    names.iter().for_each(|name| header.push_str(&format!("property float {name}\n")));
    let [count, item] = list;
    let _ = writeln!(header, "element face {faces}");
    let _ = writeln!(header, "property list {} {} vertex_indices\nend_header", count.0, item.0);
    let coordinate = |i: usize, j: usize| ((i * 7 + j * 3) % 5) as f64 * 0.25;
    let corner = |i: usize, j: usize| ((i + j) % vertices) as u64;
    let mut text = String::new();
    let big = *format == "binary_big_endian";
    let mut binary = if big { Layout::big_endian() } else { Layout::default() };
    for i in 0..*vertices {
        let row: Vec<f64> = (0..names.len()).map(|j| coordinate(i, j)).collect();
        binary = row.iter().fold(binary, |layout, value| layout.float(*value, 4));
        let words: Vec<String> = row.iter().map(f64::to_string).collect();
        let _ = writeln!(text, "{}", words.join(" "));
    }
    for i in 0..*faces {
        let _ = writeln!(text, "3 {} {} {}", corner(i, 0), corner(i, 1), corner(i, 2));
        binary = binary.integer(3, count.1);
        binary = (0..3).fold(binary, |layout, j| layout.integer(corner(i, j), item.1));
    }
    let text = (*format == "ascii").then(|| Lines::new(&text, ' '));
    Ply { header: Lines::new(&header, ' '), text, binary }
}

fn plys() -> impl Strategy<Value = Ply> + Clone {
    let formats = prop::sample::select(vec!["ascii", "binary_little_endian", "binary_big_endian"]);
    let counts = prop::sample::select(vec![("uchar", 1), ("int", 4), ("uint", 4), ("ushort", 2)]);
    let items = prop::sample::select(vec![("int", 4), ("uint", 4), ("ushort", 2), ("uchar", 1)]);
    let empty = prop_oneof![
        9 => Just(None),
        1 => prop::sample::select(vec![0, 5, 1_000_000_000, 1 << 60]).prop_map(Some),
    ];
    (3..8usize, 1..6usize, formats, any::<bool>(), counts, items, empty).prop_map(
        |(vertices, faces, format, normals, count, item, empty)| {
            ply(&Elements { vertices, faces, format, normals, list: [count, item], empty })
        },
    )
}

fn obj(vertices: usize, faces: usize, style: usize) -> Lines {
    let mut text = "# a mesh\nmtllib a.mtl\no part\n".to_owned();
    for i in 0..vertices {
        let _ = writeln!(text, "v {} {} {}", i % 3, 0.5 * i as f64, (i * i) % 4);
    }
    for i in 0..faces {
        let corner = |j: usize| (i + j) % vertices + 1;
        let word = |j: usize| match style {
            0 => corner(j).to_string(),
            1 => format!("{}/1/1", corner(j)),
            2 => format!("{}//2", corner(j)),
            _ => format!("-{}", corner(j)),
        };
        let _ = writeln!(text, "f {} {} {}", word(0), word(1), word(2));
    }
    Lines::new(&text, ' ')
}

/// A file `mesh.ply` or `mesh.obj`.
pub(crate) fn mesh_files() -> BoxedStrategy<Case> {
    let objs = (3..9usize, 1..6usize, 0..4usize).prop_map(|(v, f, style)| obj(v, f, style));
    let ply = |ply: Ply| Case::default().file("mesh.ply", ply.to_bytes());
    let obj = |lines: Lines| Case::default().file("mesh.obj", lines.to_bytes());
    prop_oneof![3 => spoiled(plys()).prop_map(ply), 1 => spoiled(objs).prop_map(obj)].boxed()
}

/// The bytes of a PLY file.
pub(crate) fn point_clouds() -> BoxedStrategy<Vec<u8>> {
    sometimes_spoiled(plys()).prop_map(|ply| ply.to_bytes()).boxed()
}
