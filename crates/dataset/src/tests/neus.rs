//! `cameras_sphere.npz`.

use std::fs::File;
use std::io::Read;

use npyz::WriterBuilder;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use super::*;

/// Writes the archive; every third array is stored by columns.
fn write_npz(folder: &Path, arrays: &[(String, DMat4)]) {
    let mut npz = ZipWriter::new(File::create(folder.join("cameras_sphere.npz")).unwrap());
    for (i, (name, matrix)) in arrays.iter().enumerate() {
        npz.start_file(format!("{name}.npy"), SimpleFileOptions::default()).unwrap();
        let (order, stored) = match i % 3 {
            2 => (npyz::Order::Fortran, *matrix),
            _ => (npyz::Order::C, matrix.transpose()),
        };
        let options = npyz::WriteOptions::new().default_dtype().shape(&[4, 4]).order(order);
        let mut array = options.writer(&mut npz).begin_nd().unwrap();
        array.extend(stored.to_cols_array()).unwrap();
        array.finish().unwrap();
    }
    npz.finish().unwrap();
}

/// Writes archive, images and masks; returns the arrays.
pub(super) fn write_neus(folder: &Path, cameras: &[Camera]) -> Vec<(String, DMat4)> {
    let mut arrays = Vec::new();
    for sub in ["image", "mask"] {
        std::fs::create_dir(folder.join(sub)).unwrap();
    }
    for (i, c) in cameras.iter().enumerate() {
        let film = photograph(c);
        write_image(&folder.join(format!("image/{i:03}.png")), &film).unwrap();
        let white =
            film.pixels.iter().map(|p| [f32::from(u8::from(*p != BACKGROUND)); 3]).collect();
        write_image(&folder.join(format!("mask/{i:03}.png")), &Film { pixels: white, ..film })
            .unwrap();
        let (r, t) = world_to_camera(c);
        let p = c.principal - 0.5;
        let k = DMat3::from_cols(DVec3::X * c.focal.x, DVec3::Y * c.focal.y, p.extend(1.0));
        let mut world = DMat4::from_mat3(k * r);
        world.w_axis = (k * t).extend(1.0);
        arrays.push((format!("world_mat_{i}"), world));
        let scale = DMat4::from_translation(ball().center) * DMat4::from_scale(DVec3::splat(0.7));
        arrays.push((format!("scale_mat_{i}"), scale));
    }
    write_npz(folder, &arrays);
    arrays
}

#[test]
fn cameras_and_sphere_are_read_in_world_units() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(9);
    write_neus(folder.path(), &all);
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    let bounds = dataset.bounds.unwrap();
    assert_relative_eq!(bounds.center, ball().center, epsilon = 1e-12);
    assert_relative_eq!(bounds.radius, 0.7, epsilon = 1e-12);
    for (view, camera) in in_order(&dataset).into_iter().zip(&all) {
        assert_same_camera(&view.camera, camera, 1e-9);
        let mask = view.coverage().unwrap();
        let film = photograph(camera);
        let covered = film.pixels.iter().map(|p| f32::from(u8::from(*p != BACKGROUND)));
        assert!(mask.iter().zip(covered).all(|(m, c)| (m - c).abs() < 1e-5));
    }
}

#[test]
fn wrong_archives_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let arrays = write_neus(folder.path(), &cameras(3));
    let with = |name: &str, change: &dyn Fn(DMat4) -> DMat4| {
        let changed =
            |(n, m): &(String, DMat4)| (n.clone(), if n == name { change(*m) } else { *m });
        write_npz(folder.path(), &arrays.iter().map(changed).collect::<Vec<_>>());
    };
    for pose in [DMat4::ZERO, DMat4::NAN] {
        with("world_mat_1", &|_| pose);
        let found = load(folder.path(), &LoadOptions::default()).unwrap();
        assert_eq!(found.notes.len(), 1, "{:?}", found.notes);
        assert!(found.notes[0].starts_with("1 image has no usable pose"), "{:?}", found.notes);
    }
    with("scale_mat_0", &|m| m * DMat4::from_scale(DVec3::new(1.0, 2.0, 1.0)));
    refused(folder.path(), &["scale_mat_0", "uniform scale"]);
    write_npz(folder.path(), &arrays[..4]);
    refused(folder.path(), &["world_mat_*", "2 arrays", "3, one for each image"]);
    let without: Vec<_> = arrays.iter().filter(|(n, _)| n != "scale_mat_1").cloned().collect();
    write_npz(folder.path(), &without);
    refused(folder.path(), &["scale_mat_1", "nothing"]);
    // An entry of 400 MB, which takes 400 kB in the archive, is inflated as far as needed: bytes in
    // the middle of it are wrong.
    let header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (10000, 10000)}";
    let mut npz = ZipWriter::new(File::create(folder.path().join("cameras_sphere.npz")).unwrap());
    for name in ["world_mat_0", "world_mat_1", "world_mat_2"] {
        npz.start_file(format!("{name}.npy"), SimpleFileOptions::default()).unwrap();
        let start =
            [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header].concat();
        let zeros = if name == "world_mat_0" { 400_000_000 } else { 0 };
        let mut entry = start.as_slice().chain(std::io::repeat(0).take(zeros));
        std::io::copy(&mut entry, &mut npz).unwrap();
    }
    npz.finish().unwrap();
    let path = folder.path().join("cameras_sphere.npz");
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[200_000..200_100].fill(0xff);
    std::fs::write(&path, bytes).unwrap();
    refused(folder.path(), &["world_mat_0", "shape [10000, 10000]"]);
    std::fs::write(folder.path().join("cameras_sphere.npz"), "no archive").unwrap();
    refused(folder.path(), &["cameras_sphere.npz", ".npz"]);
}

#[test]
fn a_folder_of_heic_photographs_is_refused_with_a_converter() {
    let folder = tempfile::tempdir().unwrap();
    write_neus(folder.path(), &cameras(3));
    let images = folder.path().join("image");
    std::fs::remove_dir_all(&images).unwrap();
    std::fs::create_dir(&images).unwrap();
    refused(folder.path(), &["image", "none", "PNG, JPEG, TIFF or WebP files"]);
    std::fs::write(images.join("a.HEIC"), b"\0\0\0\x18ftypheic\0\0\0\0mif1heic").unwrap();
    refused(folder.path(), &["a.HEIC", "HEIC", "heif-convert"]);
}

#[test]
fn idr_archives_are_read_and_images_may_be_missing() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(9);
    write_neus(folder.path(), &all);
    let at = |name: &str| folder.path().join(name);
    std::fs::rename(at("cameras_sphere.npz"), at("cameras.npz")).unwrap();
    let found = forms::assert_agrees_with_nerf(folder.path(), &all);
    assert!(found.format.contains("cameras.npz") && found.bounds.is_some());
    // The masks tell which images are missing; without them, the numbers in the names.
    std::fs::remove_file(at("image/000.png")).unwrap();
    std::fs::remove_file(at("image/005.png")).unwrap();
    let found = load(folder.path(), &LoadOptions::default()).unwrap();
    let note = "2 of 9 images are missing and left out: image/000, image/005";
    assert_eq!(found.notes, [note]);
    let rest = all[1..5].iter().chain(&all[6..]);
    for (view, camera) in in_order(&found).into_iter().zip(rest) {
        assert_same_camera(&view.camera, camera, 1e-9);
    }
    std::fs::remove_dir_all(at("mask")).unwrap();
    refused(folder.path(), &["cameras.npz", "9 arrays", "7, one for each image"]);
}
