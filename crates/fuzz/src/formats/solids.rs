//! Meshes: binary glTF and STL.

use std::fmt::Write;

use proptest::prelude::*;
use serde_json::{Value, json};

use crate::case::Case;
use crate::layout::Layout;
use crate::lines::Lines;
use crate::spoil::{Spoil, spoiled};
use crate::tree::Tree;

/// A .glb file: a JSON chunk and a binary chunk.
#[derive(Clone, Debug)]
struct Glb {
    document: Tree,
    data: Layout,
    /// A place and a number of harm to the header and the headers of the chunks.
    frame_harm: Option<(usize, usize)>,
}

impl Glb {
    fn to_bytes(&self) -> Vec<u8> {
        let mut text = self.document.json();
        text.resize(text.len().next_multiple_of(4), b' ');
        let data = self.data.to_bytes();
        let total = 28 + text.len() + data.len();
        let mut file = Layout::default().bytes(*b"glTF").integer(2, 4).integer(total as u64, 4);
        file = file.integer(text.len() as u64, 4).bytes(*b"JSON").bytes(text);
        file = file.integer(data.len() as u64, 4).bytes(*b"BIN\0").bytes(data);
        if let Some((place, harm)) = self.frame_harm {
            file.spoil(place, harm);
        }
        file.to_bytes()
    }
}

impl Spoil for Glb {
    fn spoil(&mut self, place: usize, harm: usize) {
        match place % 4 {
            0 => self.frame_harm = Some((place / 4, harm)),
            1 => self.data.spoil(place / 4, harm),
            _ => self.document.spoil(place / 4, harm),
        }
    }
}

/// The elements of a .glb file.
#[derive(Clone, Debug)]
struct Elements {
    vertices: usize,
    faces: usize,
    /// The glTF type of an index and its bytes; no indices for 0 bytes.
    index: (u32, usize),
    stride: Option<usize>,
    /// The way in which nodes place the mesh.
    nodes: usize,
}

/// The nodes of a file, and those of its scene.
fn nodes(style: usize) -> (Value, Value) {
    let turned = json!({"children": [1], "rotation": [0, 0, 0, 1], "scale": [2, 2, 2],
        "extras": {"dsdf:view": true}});
    match style {
        0 => (json!([{"mesh": 0}]), json!([0])),
        1 => (json!([turned, {"mesh": 0, "translation": [1e6, 0, 0]}]), json!([0])),
        2 => {
            let matrix = [0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1];
            (json!([{"mesh": 0, "matrix": matrix}, {"mesh": 0}]), json!([0, 1]))
        }
        _ => (json!([{"children": [1, 2]}, {"mesh": 0, "children": []}, {}]), json!([0])),
    }
}

fn glb(elements: &Elements) -> Glb {
    let Elements { vertices, faces, index: (index_type, width), stride, nodes: style } = elements;
    let step = stride.unwrap_or(12);
    let mut data = Layout::default();
    for i in 0..*vertices {
        for k in 0..3 {
            data = data.float(((i * 5 + k * 3) % 7) as f64 * 0.25, 4);
        }
        data = data.bytes(vec![0; step - 12]);
    }
    // Without indices, three vertices in a row are a face.
    let corners = if *width == 0 { 0 } else { 3 * faces };
    data = (0..corners)
        .fold(data, |data, i| data.integer(((i / 3 + i % 3) % vertices) as u64, *width));
    let (all, of_scene) = nodes(*style);
    let mut positions = json!({"buffer": 0, "byteLength": step * vertices});
    if stride.is_some() {
        positions["byteStride"] = json!(step);
    }
    let mut primitive = json!({"attributes": {"POSITION": 0}, "mode": 4});
    if *width > 0 {
        primitive["indices"] = json!(1);
    }
    let document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": of_scene}], "nodes": all,
        "meshes": [{"primitives": [primitive]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": vertices, "type": "VEC3"},
            {"bufferView": 1, "byteOffset": 0, "componentType": index_type, "count": corners,
                "type": "SCALAR"}],
        "bufferViews": [
            positions,
            {"buffer": 0, "byteOffset": step * vertices, "byteLength": corners * width}],
        "buffers": [{"byteLength": step * vertices + corners * width}]
    });
    Glb { document: document.into(), data, frame_harm: None }
}

fn glbs() -> impl Strategy<Value = Glb> + Clone {
    let index = prop::sample::select(vec![(5125, 4), (5123, 2), (5121, 1), (5125, 0)]);
    let stride = prop::sample::select(vec![None, Some(12), Some(24)]);
    (1..4usize, 1..6usize, index, stride, 0..4usize).prop_map(
        |(triples, faces, index, stride, nodes)| {
            glb(&Elements { vertices: 3 * triples, faces, index, stride, nodes })
        },
    )
}

/// A binary .stl file; its header may begin as that of a text file.
fn binary_stl(faces: usize, header: &[u8; 5]) -> Layout {
    let mut file = Layout::default().bytes(*header).bytes([b' '; 75]).integer(faces as u64, 4);
    for i in 0..faces {
        let number = |k: usize| ((i * 5 + k * 3) % 7) as f64 * 0.25;
        file = (0..12).fold(file, |file, k| file.float(number(k), 4)).integer(0, 2);
    }
    file
}

/// A .stl file of text.
fn text_stl(faces: usize) -> Lines {
    let mut text = "solid a mesh\n".to_owned();
    for i in 0..faces {
        text.push_str("facet normal 0 0 1\nouter loop\n");
        for k in 0..3 {
            let _ = writeln!(text, "vertex {} {} {}", (i + k) % 3, 0.5 * k as f64, (i * k) % 2);
        }
        text.push_str("endloop\nendfacet\n");
    }
    Lines::new(&(text + "endsolid a mesh\n"), ' ')
}

/// A file `mesh.glb` or `mesh.stl`.
pub(crate) fn solid_files() -> BoxedStrategy<Case> {
    let headers = prop::sample::select(vec![*b"dsdf ", *b"solid"]);
    let binaries = (0..6usize, headers).prop_map(|(faces, header)| binary_stl(faces, &header));
    let texts = (0..5usize).prop_map(text_stl);
    let glb = |glb: Glb| Case::default().file("mesh.glb", glb.to_bytes());
    let stl = |bytes: Vec<u8>| Case::default().file("mesh.stl", bytes);
    prop_oneof![
        3 => spoiled(glbs()).prop_map(glb),
        1 => spoiled(binaries).prop_map(move |layout| stl(layout.to_bytes())),
        1 => spoiled(texts).prop_map(move |lines| stl(lines.to_bytes())),
    ]
    .boxed()
}
