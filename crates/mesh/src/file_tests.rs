use std::path::Path;

use glam::{DVec3, Vec3};
use proptest::prelude::*;

use crate::{Mesh, read_mesh, write_mesh};

fn tetrahedron() -> Mesh {
    let vertices = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.1, 1.0 / 3.0, 1e-7)];
    let normals = vec![Vec3::NEG_X, Vec3::X, Vec3::Y, Vec3::Z];
    Mesh {
        vertices,
        normals,
        faces: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
        ..Mesh::default()
    }
}

/// Reads a file of the given name and content.
fn read_bytes(name: &str, bytes: &[u8]) -> Result<Mesh, files::InputError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    read_mesh(&path)
}

/// The content of the file that the mesh is written to.
fn written(name: &str, mesh: &Mesh) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write_mesh(&path, mesh).unwrap();
    std::fs::read(&path).unwrap()
}

#[test]
fn meshes_that_are_written_and_read_are_equal() {
    let bare = Mesh { normals: vec![], ..tetrahedron() };
    for mesh in [tetrahedron(), bare] {
        assert_eq!(read_bytes("a.ply", &written("a.ply", &mesh)).unwrap(), mesh);
        let obj = read_bytes("a.OBJ", &written("a.obj", &mesh)).unwrap();
        assert_eq!((&obj.vertices, &obj.faces), (&mesh.vertices, &mesh.faces));
    }
    let error = write_mesh(Path::new("a.off"), &tetrahedron()).unwrap_err();
    assert!(error.input().is_some());
}

/// Digits of single precision would leave steps of 0.06 units at this distance.
#[test]
fn a_distant_mesh_keeps_its_digits_in_every_format() {
    let origin = DVec3::new(1e6, -2e6, 3e6);
    let mesh = Mesh { origin, ..tetrahedron() };
    for name in ["a.ply", "a.obj"] {
        let read = read_bytes(name, &written(name, &mesh)).unwrap();
        assert!((read.origin - origin).length() < 2.0, "{}", read.origin);
        for (a, b) in read.about(origin).vertices.iter().zip(&mesh.vertices) {
            assert!((*a - *b).length() < 1e-6, "{name}: {a} instead of {b}");
        }
    }
    let glb = written("a.glb", &mesh);
    let (json, _) = glb_chunks(&glb);
    assert_eq!(json["nodes"][0]["translation"], serde_json::json!([1e6, -2e6, 3e6]));
}

/// The JSON chunk and the binary chunk of a .glb file (glTF 2.0, section 4.4).
fn glb_chunks(bytes: &[u8]) -> (serde_json::Value, &[u8]) {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!((&bytes[..4], word(4), word(8) as usize), (&b"glTF"[..], 2, bytes.len()));
    let json = word(12) as usize;
    assert_eq!(
        (json % 4, &bytes[16..20], &bytes[24 + json..28 + json]),
        (0, &b"JSON"[..], &b"BIN\0"[..])
    );
    assert_eq!(word(20 + json) as usize, bytes.len() - 28 - json);
    (serde_json::from_slice(&bytes[20..20 + json]).unwrap(), &bytes[28 + json..])
}

#[test]
fn the_accessors_of_a_glb_file_give_the_mesh() {
    for normals in [true, false] {
        let mut mesh = tetrahedron();
        if !normals {
            mesh.normals.clear();
        }
        let bytes = written("a.glb", &mesh);
        let (json, data) = glb_chunks(&bytes);
        let primitive = &json["meshes"][0]["primitives"][0];
        let words = |accessor: &serde_json::Value| -> Vec<u32> {
            let accessor = &json["accessors"][accessor.as_u64().unwrap() as usize];
            let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
            let [start, length] =
                ["byteOffset", "byteLength"].map(|k| view[k].as_u64().unwrap() as usize);
            let per_item = if accessor["type"] == "VEC3" { 12 } else { 4 };
            assert_eq!(accessor["count"].as_u64().unwrap() as usize * per_item, length);
            data[start..start + length]
                .chunks(4)
                .map(|b| u32::from_le_bytes(b.try_into().unwrap()))
                .collect()
        };
        let bits = |v: &[Vec3]| {
            v.iter().flat_map(|v| v.to_array().map(f32::to_bits)).collect::<Vec<u32>>()
        };
        assert_eq!(words(&primitive["attributes"]["POSITION"]), bits(&mesh.vertices));
        assert_eq!(words(&primitive["indices"]), mesh.faces.as_flattened());
        if normals {
            assert_eq!(words(&primitive["attributes"]["NORMAL"]), bits(&mesh.normals));
        } else {
            assert!(primitive["attributes"]["NORMAL"].is_null());
        }
        assert_eq!(json["buffers"][0]["byteLength"], data.len());
        assert_eq!(json["accessors"][0]["max"], serde_json::json!([1.0, 1.0, mesh.vertices[3].z]));
    }
}

#[test]
fn files_of_other_programs_are_read() {
    let ascii = b"ply\nformat ascii 1.0\ncomment made elsewhere\n\
        element vertex 5\nproperty double x\nproperty double y\nproperty int z\n\
        property uchar red\n\
        element face 2\nproperty list uchar uint vertex_index\nproperty float quality\n\
        end_header\n\
        0 0 0 255\n1 0 0 255\n1 1 0 255\n0 1 0 255\n0.5 0.5 2 0\n\
        4 0 1 2 3 0.5\n3 0 1 4 0.5\n";
    let mesh = read_bytes("a.ply", ascii).unwrap();
    assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 1, 4]]);
    assert_eq!((mesh.vertices[4], mesh.normals.len()), (Vec3::new(0.5, 0.5, 2.0), 0));

    let mut big_endian = b"ply\nformat binary_big_endian 1.0\n\
        element vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar short vertex_indices\nend_header\n"
        .to_vec();
    for v in [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.5, 0.0] {
        big_endian.extend(v.to_be_bytes());
    }
    big_endian.extend([3, 0, 2, 0, 1, 0, 0]);
    let mesh = read_bytes("a.ply", &big_endian).unwrap();
    assert_eq!((mesh.vertices[2].y, mesh.faces), (2.5, vec![[2, 1, 0]]));

    // Groups share vertices, indices count backwards, and a face comes before its last vertex.
    let obj = b"mtllib none.mtl\no part\nv 0 0 0 1 0 0\nv 1 0 0\r\nv 1 1 0\nvt 0 0\nvn 0 0 1\n\
        g one\nusemtl red\nf 1/1/1 2/1/1 3/1/1 # front\n\
        g two\nf -3//1 3//1 4//1\nv 0 1 0\n";
    let mesh = read_bytes("a.obj", obj).unwrap();
    assert_eq!((mesh.vertices.len(), mesh.faces), (4, vec![[0, 1, 2], [0, 2, 3]]));
}

#[test]
fn the_error_of_a_wrong_mesh_names_the_place() {
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let obj = |rest: &str| (vertices.to_owned() + rest, "a.obj");
    let ply = |x: &str, face: &str| {
        (
            format!(
                "ply\nformat ascii 1.0\n\
                element vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nend_header\n\
                {x} 0 0\n1 0 0\n0 1 0\n{face}\n"
            ),
            "a.ply",
        )
    };
    for ((text, name), field) in [
        (obj(""), "faces: found none"),
        (obj("v nan 0 0\nf 1 2 4\n"), "vertex 3"),
        (obj("v 1e99 0 0\nf 1 2 4\n"), "vertex 3"),
        (obj("f 1 2 4\n"), "triangle 0"),
        (obj("f 1 2 0\n"), "line 4: found f 1 2 0"),
        (obj("f 1 2 -4\n"), "line 4"),
        (obj("f 1 2\n"), "line 4"),
        (obj("v 1 2\nf 1 2 3\n"), "line 4: found v 1 2"),
        (ply("1e99", "3 0 1 2"), "vertex 0"),
        (ply("0", "3 0 1 3"), "triangle 0: found vertices [0, 1, 3]"),
        (ply("0", "3 0 1 -1"), "face 0: found index -1, expected indices from 0 to below 3"),
        (ply("0", "2 0 1"), "faces: found none"),
        (ply("0", "4 0 1 2"), "mesh"),
        (ply("zero", "3 0 1 2"), "mesh"),
        (("v 0 0 0\n".to_owned(), "a.off"), "extension \"off\""),
    ] {
        let error = read_bytes(name, text.as_bytes()).unwrap_err().to_string();
        assert!(
            error.contains(field) && error.contains(name) && error.lines().count() == 1,
            "{error}"
        );
    }
    let error = read_mesh(Path::new("none.ply")).unwrap_err();
    assert!(error.to_string().contains("no such file"), "{error}");
}

#[test]
fn cut_files_are_refused() {
    let whole = written("a.ply", &tetrahedron());
    for length in 0..whole.len() {
        assert!(read_bytes("a.ply", &whole[..length]).is_err(), "cut at {length}");
    }
}

#[test]
fn a_header_with_counts_beyond_the_file_is_refused() {
    let header = |count: &str, list: &str| {
        format!(
            "ply\nformat binary_little_endian 1.0\n\
            element vertex {count}\nproperty float x\nproperty float y\nproperty float z\n\
            element face {count}\nproperty list {list} int vertex_indices\nend_header\n"
        )
    };
    for count in ["4000000000", "18446744073709551615"] {
        let error = read_bytes("a.ply", header(count, "uchar").as_bytes()).unwrap_err().to_string();
        let place = "a.ply: element vertex: found a count of ";
        assert!(error.contains(place) && error.contains("in a file with 0 bytes"), "{error}");
    }
    // Elements without properties take no bytes of the file, and memory for each.
    for encoding in ["ascii", "binary_little_endian"] {
        let header = format!(
            "ply\nformat {encoding} 1.0\nelement vertex 1000000000\nelement face 1\n\
            property list uchar int vertex_indices\nend_header\n"
        );
        let error = read_bytes("a.ply", header.as_bytes()).unwrap_err().to_string();
        assert!(error.contains("1000000000 elements without properties"), "{error}");
    }
    let mut long_list = header("1", "uint").into_bytes();
    long_list.extend([0; 12]);
    long_list.extend(u32::MAX.to_le_bytes());
    assert!(read_bytes("a.ply", &long_list).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]
    #[test]
    fn damaged_files_never_panic(
        changes in prop::collection::vec((any::<usize>(), any::<u8>()), 1..6),
        cut in any::<usize>(),
    ) {
        for name in ["a.ply", "a.obj", "a.glb", "a.stl"] {
            let mut bytes = written(name, &tetrahedron());
            let length = bytes.len();
            changes.iter().for_each(|(at, byte)| bytes[at % length] = *byte);
            let check = |read: Result<Mesh, files::InputError>| match read {
                Ok(mesh) => {
                    prop_assert!(mesh.vertices.iter().all(|v| v.is_finite()));
                    let count = mesh.vertices.len();
                    prop_assert!(mesh.faces.as_flattened().iter().all(|v| (*v as usize) < count));
                    Ok(())
                }
                Err(e) => {
                    prop_assert_eq!(e.to_string().lines().count(), 1);
                    Ok(())
                }
            };
            check(read_bytes(name, &bytes))?;
            check(read_bytes(name, &bytes[..cut % length]))?;
        }
    }
}
