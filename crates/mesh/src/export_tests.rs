//! Colours, directions, factors and faces of files, read by other programs' readers or by hand.

use std::collections::HashMap;
use std::path::Path;

use approx::assert_relative_eq;
use field::{Kind, Shape, Sphere};
use film::{Film, srgb_encode};
use glam::{DVec3, Quat, Vec2, Vec3};

use crate::{Export, Mesh, Texture, decimate, export_mesh, extract, read_mesh};

/// A coloured torus around the z axis.
fn torus(resolution: usize) -> Mesh {
    let torus = Shape::<f64>::new(Kind::Torus, &[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.7, 0.25]);
    let bounds = Sphere { center: DVec3::ZERO, radius: 1.2 };
    let mut mesh = extract(&torus, &bounds, resolution, &|_| {});
    mesh.colors =
        mesh.vertices.iter().map(|v| (*v * 0.4 + 0.5).clamp(Vec3::ZERO, Vec3::ONE)).collect();
    mesh
}

/// The content of the file that the mesh is exported to, and the mesh as read from it.
fn exported(name: &str, mesh: &Mesh, export: &Export) -> (Vec<u8>, Mesh) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    export_mesh(&path, mesh, export).unwrap();
    (std::fs::read(&path).unwrap(), read_mesh(&path).unwrap())
}

/// The largest difference of corresponding vectors.
fn difference(a: &[Vec3], b: &[Vec3]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f32::max)
}

fn srgb(colors: &[Vec3]) -> Vec<Vec3> {
    colors.iter().map(|c| Vec3::from(c.to_array().map(srgb_encode))).collect()
}

/// Positions, normals, colours and faces of a .glb file, by the crate `gltf`.
fn by_gltf(bytes: &[u8]) -> (Mesh, gltf::Document) {
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice(bytes).unwrap();
    let mut mesh = Mesh::default();
    for primitive in document.meshes().flat_map(|m| m.primitives().collect::<Vec<_>>()) {
        let reader = primitive.reader(|_| blob.as_deref());
        mesh.vertices = reader.read_positions().unwrap().map(Vec3::from).collect();
        mesh.normals = reader.read_normals().unwrap().map(Vec3::from).collect();
        let colors = reader.read_colors(0).map(|colors| colors.into_rgb_f32());
        mesh.colors = colors.into_iter().flatten().map(Vec3::from).collect();
        let corners: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        mesh.faces = corners.chunks_exact(3).map(|f| [f[0], f[1], f[2]]).collect();
    }
    (mesh, document)
}

#[test]
fn a_glb_file_has_linear_colours_and_a_rough_material() {
    let mesh = torus(32);
    let (bytes, _) = exported("a.glb", &mesh, &Export::default());
    let (read, document) = by_gltf(&bytes);
    assert_eq!(
        (&read.vertices, &read.normals, &read.faces),
        (&mesh.vertices, &mesh.normals, &mesh.faces)
    );
    assert!(difference(&read.colors, &mesh.colors) < 1e-5);
    let material = document.materials().next().unwrap();
    let rough = material.pbr_metallic_roughness();
    assert_eq!((rough.metallic_factor(), rough.roughness_factor()), (0.0, 1.0));
    assert!(!material.double_sided());
    let open = Mesh { faces: mesh.faces[1..].to_vec(), ..mesh.clone() };
    let (bytes, _) = exported("a.glb", &open, &Export::default());
    assert!(by_gltf(&bytes).1.materials().next().unwrap().double_sided());
    let grey = Mesh { colors: Vec::new(), ..mesh };
    let (bytes, _) = exported("a.glb", &grey, &Export::default());
    let (read, document) = by_gltf(&bytes);
    assert!(read.colors.is_empty() && document.materials().next().is_none());
}

#[test]
fn the_node_of_a_glb_file_turns_up_to_y_and_scales_but_the_reader_undoes_it() {
    let mesh = Mesh { origin: DVec3::new(10.0, 20.0, 30.0), ..torus(16) };
    for up in [DVec3::X, DVec3::Z, DVec3::NEG_Y, DVec3::new(0.6, 0.0, -0.8)] {
        let (bytes, read) = exported("a.glb", &mesh, &Export { scale: 2.5, up, texture: None });
        let (_, document) = by_gltf(&bytes);
        let root = document.default_scene().unwrap().nodes().next().unwrap();
        let (_, rotation, scale) = root.transform().decomposed();
        assert!((Quat::from_array(rotation) * up.as_vec3() - Vec3::Y).length() < 1e-6);
        assert_eq!(scale, [2.5; 3]);
        let child = root.children().next().unwrap();
        assert_eq!(child.transform().decomposed().0, [10.0, 20.0, 30.0]);
        assert!(child.mesh().is_some());
        assert!(difference(&read.about(mesh.origin).vertices, &mesh.vertices) < 1e-6);
    }
}

#[test]
fn other_nodes_of_a_glb_file_are_applied() {
    let mesh = torus(16);
    let (mut bytes, _) =
        exported("a.glb", &mesh, &Export { scale: 2.0, up: DVec3::Z, texture: None });
    // A key of the same length that is not dsdf's.
    let key = b"dsdf:view";
    let at = bytes.windows(key.len()).position(|w| w == key).unwrap();
    bytes[at] = b'x';
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    std::fs::write(&path, &bytes).unwrap();
    let turned: Vec<Vec3> = mesh.vertices.iter().map(|v| 2.0 * Vec3::new(v.x, v.z, -v.y)).collect();
    assert!(difference(&read_mesh(&path).unwrap().vertices, &turned) < 1e-5);
}

#[test]
fn colours_of_obj_and_ply_are_srgb() {
    let mesh = torus(16);
    let (bytes, read) = exported("a.obj", &mesh, &Export { scale: 0.5, ..Export::default() });
    let options = tobj::LoadOptions::default();
    let (models, _) = tobj::load_obj_buf(&mut &bytes[..], &options, |_: &Path| {
        Err(tobj::LoadError::GenericFailure)
    })
    .unwrap();
    let triples =
        |numbers: &[f32]| -> Vec<Vec3> { numbers.chunks_exact(3).map(Vec3::from_slice).collect() };
    let half: Vec<Vec3> = mesh.vertices.iter().map(|v| *v * 0.5).collect();
    assert!(difference(&triples(&models[0].mesh.positions), &half) < 1e-7);
    let colors = triples(&models[0].mesh.vertex_color);
    assert!(difference(&colors, &srgb(&mesh.colors)) < 1e-4);
    assert_eq!(models[0].mesh.indices, mesh.faces.as_flattened());
    assert!(difference(&read.vertices, &half) < 1e-7);

    let (bytes, read) = exported("a.ply", &mesh, &Export::default());
    let (vertices, faces) = (mesh.vertices.len(), mesh.faces.len());
    let header = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let text = String::from_utf8_lossy(&bytes[..header]);
    assert!(text.contains("float nz\nproperty uchar red\nproperty uchar green\n"));
    assert_eq!(bytes.len(), header + 27 * vertices + 13 * faces);
    let colors: Vec<Vec3> = bytes[header..header + 27 * vertices]
        .chunks_exact(27)
        .map(|v| Vec3::from([24, 25, 26].map(|i| f32::from(v[i]) / 255.0)))
        .collect();
    assert!(difference(&colors, &srgb(&mesh.colors)) < 0.51 / 255.0);
    assert_eq!((read.vertices, read.normals), (mesh.vertices, mesh.normals));
}

/// A mesh of two triangles with a seam along their common edge, and an image of 4 × 2 texels.
fn textured() -> (Mesh, Texture) {
    let vertices = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 0.0)];
    let faces = vec![[0, 1, 2], [2, 1, 3]];
    let colors = vec![Vec3::ONE; 4];
    let mesh = Mesh { normals: vec![Vec3::Z; 4], vertices, faces, colors, ..Mesh::default() };
    let mut image = Film::new(4, 2);
    image.pixels.iter_mut().enumerate().for_each(|(i, p)| *p = [i as f32 / 8.0, 0.25, 1.0]);
    let points: Vec<Vec2> =
        (0..6).map(|i| Vec2::new(i as f32 / 8.0, (i % 2) as f32 / 4.0)).collect();
    let vertices = vec![0, 1, 2, 2, 1, 3];
    (mesh, Texture { image, points, vertices, corners: vec![[0, 1, 2], [3, 4, 5]] })
}

/// The bytes of an image as a .png file has them.
fn bytes_of(film: &Film) -> Vec<u8> {
    let byte = |v: &f32| (srgb_encode(*v) * 255.0).round() as u8;
    film.pixels.as_flattened().iter().map(byte).collect()
}

#[test]
fn a_textured_glb_file_has_its_image_inside_and_reads_as_the_mesh() {
    let (mesh, texture) = textured();
    let (bytes, read) =
        exported("a.glb", &mesh, &Export { texture: Some(&texture), ..Export::default() });
    assert_eq!((&read.vertices, &read.faces), (&mesh.vertices, &mesh.faces));
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice(&bytes).unwrap();
    let blob = blob.unwrap();
    let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
    let reader = primitive.reader(|_| Some(&blob));
    assert!(reader.read_colors(0).is_none(), "viewers multiply them with the texture");
    let points: Vec<Vec2> = reader.read_tex_coords(0).unwrap().into_f32().map(Vec2::from).collect();
    assert_eq!(points, texture.points);
    let positions: Vec<Vec3> = reader.read_positions().unwrap().map(Vec3::from).collect();
    assert_eq!(positions[3], mesh.vertices[2]);
    let material = primitive.material().pbr_metallic_roughness();
    let source = material.base_color_texture().unwrap().texture().source().source();
    let gltf::image::Source::View { view, mime_type } = source else { panic!("no image inside") };
    assert_eq!(mime_type, "image/png");
    let png = &blob[view.offset()..view.offset() + view.length()];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    std::fs::write(&path, png).unwrap();
    let (image, _) = film::read_image(&path).unwrap();
    assert_eq!(bytes_of(&image), bytes_of(&texture.image));
}

#[test]
fn a_textured_obj_file_has_its_material_and_image_beside_it() {
    let (mesh, texture) = textured();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a shape.obj");
    let export = Export { texture: Some(&texture), ..Export::default() };
    export_mesh(&path, &mesh, &export).unwrap();
    let options = tobj::LoadOptions::default();
    let (models, materials) = tobj::load_obj(&path, &options).unwrap();
    let material = &materials.unwrap()[models[0].mesh.material_id.unwrap()];
    let image = material.diffuse_texture.as_ref().unwrap();
    assert_eq!(image, "a_shape_texture.png");
    let (image, _) = film::read_image(&folder.path().join(image)).unwrap();
    assert_eq!(bytes_of(&image), bytes_of(&texture.image));
    let read = &models[0].mesh;
    assert_eq!(read.indices, mesh.faces.as_flattened());
    assert!(read.vertex_color.is_empty());
    for (i, point) in read.texcoord_indices.iter().enumerate() {
        let found = Vec2::from_slice(&read.texcoords[2 * *point as usize..]);
        let expected = texture.points[texture.corners.as_flattened()[i] as usize];
        assert!((Vec2::new(found.x, 1.0 - found.y) - expected).length() < 1e-6);
    }
    assert_eq!(read_mesh(&path).unwrap().faces, mesh.faces);
    // The files of an earlier export are replaced, those of another program are not.
    export_mesh(&path, &mesh, &export).unwrap();
    std::fs::write(folder.path().join("a_shape.mtl"), "newmtl mine\n").unwrap();
    let error = export_mesh(&path, &mesh, &export).unwrap_err().to_string();
    assert!(error.contains("a_shape.mtl: output: found a file of another program"), "{error}");
    std::fs::write(folder.path().join("b_texture.png"), "mine").unwrap();
    for (name, word) in [("b.obj", "b_texture.png"), (" c.obj", "name"), ("-s 1.obj", "name")] {
        let error = export_mesh(&folder.path().join(name), &mesh, &export).unwrap_err();
        assert!(error.input().is_some() && error.to_string().contains(word), "{error}");
        assert!(!folder.path().join(name).exists());
    }
    for name in ["a.ply", "a.stl"] {
        let error = export_mesh(&folder.path().join(name), &mesh, &export).unwrap_err();
        assert!(error.to_string().contains("expected .glb, .usdz or .obj"), "{error}");
    }
}

#[test]
fn a_usdz_file_is_an_archive_of_aligned_files_with_the_mesh_as_text() {
    let (mesh, texture) = textured();
    let folder = tempfile::tempdir().unwrap();
    let written = |name: &str, mesh: &Mesh, export: &Export| {
        let path = folder.path().join(name);
        export_mesh(&path, mesh, export).unwrap();
        std::fs::read(&path).unwrap()
    };
    let export = Export { texture: Some(&texture), up: DVec3::Z, scale: 2.0 };
    let bytes = written("a.usdz", &mesh, &export);
    assert_eq!(bytes, written("b.usdz", &mesh, &export), "the same bytes at any time");
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(&bytes)).unwrap();
    let mut files = Vec::new();
    for i in 0..archive.len() {
        let mut file = archive.by_index(i).unwrap();
        let name = file.name().unwrap().into_owned();
        assert_eq!(file.data_start().unwrap() % 64, 0, "{name}");
        assert_eq!(file.compression(), zip::CompressionMethod::Stored);
        let mut content = Vec::new();
        std::io::Read::read_to_end(&mut file, &mut content).unwrap(); // It checks the sum.
        files.push((name, content));
    }
    let [(scene, text), (image, png)] = &files[..] else { panic!("{}", files.len()) };
    assert_eq!((scene.as_str(), image.as_str()), ("object.usda", "texture.png"));
    let read = image::load_from_memory(png).unwrap().into_rgb8();
    assert_eq!(read.into_raw(), bytes_of(&texture.image));
    let text = std::str::from_utf8(text).unwrap();
    assert!(text.starts_with("#usda 1.0\n") && text.contains("asset inputs:file = @texture.png@"));
    // From z to y is a quarter turn about −x.
    assert!(
        text.contains("xformOp:orient = (0.707")
            && text.contains("double3 xformOp:scale = (2, 2, 2)")
    );
    let list = |name: &str| {
        let (_, rest) = text.split_once(&format!(" {name} = [")).unwrap();
        let numbers = rest.split_once(']').unwrap().0.replace(['(', ')'], "");
        numbers.split(", ").map(|n| n.parse::<f32>().unwrap()).collect::<Vec<_>>()
    };
    let indices = list("faceVertexIndices");
    let corners: Vec<f32> = texture.corners.as_flattened().iter().map(|i| *i as f32).collect();
    assert_eq!(indices, corners);
    assert_eq!(list("faceVertexCounts"), vec![3.0; mesh.faces.len()]);
    let places = texture.vertices.iter().flat_map(|v| mesh.vertices[*v as usize].to_array());
    assert_eq!(list("points"), places.collect::<Vec<_>>());
    let upwards = texture.points.iter().flat_map(|p| [p.x, 1.0 - p.y]);
    assert_eq!(list("primvars:st"), upwards.collect::<Vec<_>>());
    // Colours of vertices, and none.
    let shown = |mesh: &Mesh| {
        String::from_utf8_lossy(&written("c.usdz", mesh, &Export::default())).into_owned()
    };
    let colored = torus(12);
    let text = shown(&colored);
    assert!(text.contains("primvars:displayColor") && !text.contains("texture.png"));
    let text = shown(&Mesh { colors: Vec::new(), ..colored });
    assert!(!text.contains("Material") && text.contains("doubleSided = 0"));
}

#[test]
fn an_stl_file_has_triangles_that_merge_to_the_mesh() {
    let mesh = torus(24);
    let (bytes, read) = exported("a.stl", &mesh, &Export { scale: 25.4, ..Export::default() });
    assert_eq!(bytes.len(), 84 + 50 * mesh.faces.len());
    assert_eq!(bytes[80..84], (mesh.faces.len() as u32).to_le_bytes());
    for (i, triangle) in bytes[84..].chunks_exact(50).enumerate() {
        let vector = |k: usize| {
            let number = |c: usize| {
                f32::from_le_bytes(triangle[12 * k + 4 * c..12 * k + 4 * c + 4].try_into().unwrap())
            };
            Vec3::new(number(0), number(1), number(2))
        };
        let [a, b, c] = mesh.faces[i].map(|v| mesh.vertices[v as usize]);
        for (k, v) in [a, b, c].into_iter().enumerate() {
            assert!((vector(k + 1) - v * 25.4).length() < 1e-4);
        }
        assert!(vector(0).dot((b - a).cross(c - a).normalize()) > 0.999);
    }
    assert_eq!((read.genus(), read.vertices.len()), (Some(1), mesh.vertices.len()));
    assert_relative_eq!(read.volume(), mesh.volume() * 25.4f64.powi(3), max_relative = 1e-5);
    let near = Mesh { origin: DVec3::new(1.3, -0.7, 40.0), ..mesh.clone() };
    let (_, read) = exported("a.stl", &near, &Export::default());
    assert_eq!((read.genus(), read.vertices.len()), (Some(1), mesh.vertices.len()));
    for (face, of_read) in near.faces.iter().zip(&read.faces) {
        let place = |mesh: &Mesh, v: u32| mesh.origin + mesh.vertices[v as usize].as_dvec3();
        assert!((place(&near, face[0]) - place(&read, of_read[0])).length() < 4e-6);
    }
    let far = Mesh { origin: DVec3::splat(1e6), ..mesh };
    let error = export_mesh(Path::new("a.stl"), &far, &Export::default()).unwrap_err();
    assert!(error.input().is_some() && error.to_string().contains("single precision"));
}

#[test]
fn stl_files_of_other_programs_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.STL");
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        read_mesh(&path)
    };
    let facet = |c: &str| {
        format!(
            "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex {c}\n\
            endloop\nendfacet\n"
        )
    };
    let text = format!("solid a b\n{}{}endsolid a b\n", facet("0 1 0"), facet("0 0 1"));
    let mesh = read(text.as_bytes()).unwrap();
    assert_eq!((mesh.vertices.len(), mesh.faces), (4, vec![[0, 1, 2], [0, 1, 3]]));
    // The header of a binary file that begins as a text file.
    let mut bytes = b"solid made elsewhere".to_vec();
    bytes.resize(80, b' ');
    bytes.extend(1u32.to_le_bytes());
    for number in [0.0f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend([0; 2]);
    assert_eq!(read(&bytes).unwrap().faces, [[0, 1, 2]]);
    bytes[80] = 2;
    bytes[..5].copy_from_slice(b"other");
    let error = read(&bytes).unwrap_err().to_string();
    assert!(error.contains("134 bytes, expected 184 bytes for 2 triangles"), "{error}");
}

#[test]
fn wrong_glb_files_are_refused_with_the_place() {
    let (bytes, _) =
        exported("a.glb", &torus(16), &Export { scale: 2.0, up: DVec3::Z, texture: None });
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    for (from, to, found) in [
        ("\"children\":[1]", "\"children\":[0]", "node"),
        ("\"children\":[1]", "\"children\":[7]", "number 7"),
        ("\"VEC3\"", "\"VEC2\"", "VEC2"),
        ("\"byteStride\"", "\"byteStride\"", ""),
        ("\"POSITION\":0", "\"POSITION\":9", "accessor 9"),
        ("\"indices\":3", "\"indices\":0", "VEC3"),
        ("glTF", "glTG", "header"),
        ("\"scene\":0", "\"scene\":5", "scene"),
        ("\"mesh\":0", "\"mesh\":4", "mesh"),
        ("\"buffer\":0", "\"buffer\":1", "no view"),
    ] {
        let Some(at) = bytes.windows(from.len()).position(|w| w == from.as_bytes()) else {
            assert!(found.is_empty(), "{from}");
            continue;
        };
        let mut bytes = bytes.clone();
        bytes[at..at + from.len()].copy_from_slice(to.as_bytes());
        std::fs::write(&path, &bytes).unwrap();
        let error = read_mesh(&path).unwrap_err().to_string();
        assert!(error.contains(found) && error.lines().count() == 1, "{from}: {error}");
    }
    std::fs::write(&path, &bytes[..bytes.len() - 9]).unwrap();
    assert!(read_mesh(&path).unwrap_err().to_string().contains("binary chunk"));
}

#[test]
fn a_decimated_torus_stays_one_and_keeps_its_colours() {
    let mesh = torus(96);
    let color_of: HashMap<_, _> =
        mesh.vertices.iter().map(|v| v.to_array().map(f32::to_bits)).zip(&mesh.colors).collect();
    for faces in [4000, 1000, 200] {
        let small = decimate(&mesh, faces);
        assert!(small.faces.len() <= faces && small.faces.len() + 8 > faces);
        assert_eq!(small.genus(), Some(1));
        assert_eq!(small.normals.len(), small.vertices.len());
        for (v, color) in small.vertices.iter().zip(&small.colors) {
            assert_eq!(color_of[&v.to_array().map(f32::to_bits)], color);
        }
        let error = (small.volume() / mesh.volume() - 1.0).abs();
        assert!(error < 24.0 / faces as f64, "{faces} faces: volume off by {error}");
    }
    assert_eq!(decimate(&mesh, mesh.faces.len()), mesh);
}

/// Thin and wavy: collapses pinch off pieces, and make the two sides of the wall touch.
#[test]
fn a_decimated_thin_solid_stays_closed_and_whole() {
    let bowl = field::Csg::new(
        field::Operation::Subtraction,
        vec![
            Box::new(Shape::<f64>::sphere([0.0; 3], 0.8)),
            Box::new(Shape::sphere([0.0, 0.0, 0.06], 0.78)),
            Box::new(Shape::sphere([0.3, 0.2, -0.8], 0.3)),
        ],
    );
    let bounds = Sphere { center: DVec3::ZERO, radius: 1.0 };
    let mesh = extract(&bowl, &bounds, 64, &|_| {});
    assert!(mesh.is_closed() && mesh.faces.len() > 20_000);
    for faces in [5000, 1000, 300] {
        let small = decimate(&mesh, faces);
        assert!(small.is_closed(), "{faces} faces");
        assert_eq!(small.components(), mesh.components(), "{faces} faces");
        assert!(small.faces.len() < faces + faces / 10);
        let mut places: Vec<_> =
            small.vertices.iter().map(|v| v.to_array().map(f32::to_bits)).collect();
        places.sort_unstable();
        places.dedup();
        assert_eq!(places.len(), small.vertices.len());
    }
}
