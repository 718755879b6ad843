//! Peculiarities of nerfstudio's `transforms.json` and of its folders.

use super::*;
use crate::tests::forms::{assert_agrees_with_nerf, resized, write_photographs};

/// The JSON of cameras with the photographs `images/{i:03}.png`.
fn transforms(cameras: &[Camera]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let mut root = write_nerf(folder.path(), "transforms.json", cameras);
    for i in 0..cameras.len() {
        root["frames"][i]["file_path"] = json!(format!("images/{i:03}.png"));
    }
    root
}

fn names(views: &[View]) -> Vec<&str> {
    views.iter().map(|v| v.name.trim_start_matches("images/").trim_end_matches(".png")).collect()
}

#[test]
fn lists_of_splits_are_followed() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(6);
    let path = folder.path().join("transforms.json");
    write_photographs(&folder.path().join("images"), &all, [WIDTH, HEIGHT]);
    let good = transforms(&all);
    let list = |numbers: &[usize]| {
        json!(numbers.iter().map(|i| format!("./images/{i:03}.png")).collect::<Vec<_>>())
    };
    let loaded = |lists: &[(&str, &[usize])]| {
        let mut root = good.clone();
        lists.iter().for_each(|(key, numbers)| root[format!("{key}_filenames")] = list(numbers));
        write_json(&path, &root);
        load(folder.path(), &LoadOptions::default()).unwrap()
    };
    let found = loaded(&[("train", &[4, 0, 1]), ("test", &[2]), ("val", &[3, 5])]);
    assert_eq!(names(&found.train), ["000", "001", "004"]);
    assert_eq!(names(&found.test), ["002"]);
    assert!(found.notes[0].starts_with("2 frames are neither"), "{:?}", found.notes);
    let found = loaded(&[("test", &[]), ("val", &[3, 5])]);
    assert_eq!(names(&found.train), ["000", "001", "002", "004"]);
    assert_eq!(names(&found.test), ["003", "005"]);
    assert!(found.notes.is_empty(), "{:?}", found.notes);
    // The file holds nothing out, and so few views are all fitted.
    let found = loaded(&[("train", &[1, 2, 3])]);
    assert_eq!((names(&found.train), names(&found.test)), (vec!["001", "002", "003"], vec![]));
}

#[test]
fn a_point_cloud_is_evidence_for_the_sphere() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(9);
    write_photographs(&folder.path().join("images"), &all, [WIDTH, HEIGHT]);
    let mut root = transforms(&all);
    root["ply_file_path"] = json!("sparse_pc.ply");
    // Poses and points have it applied: it changes nothing.
    root["applied_transform"] = json!([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 5]]);
    write_json(&folder.path().join("transforms.json"), &root);
    let found = assert_agrees_with_nerf(folder.path(), &all);
    assert_eq!(found.notes, ["the point cloud sparse_pc.ply (ply_file_path) is missing"]);
    let file = folder.path().join("sparse_pc.ply");
    let points: Vec<DVec3> = (0..100)
        .map(|i| {
            let (s, c) = (2.4 * f64::from(i)).sin_cos();
            let z = f64::from(i) / 50.0 - 0.99;
            let r = (1.0 - z * z).sqrt();
            ball().center + ball().radius * DVec3::new(c * r, s * r, z)
        })
        .collect();
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment made by a test\nelement vertex 100\nproperty \
             float x\nproperty float y\nproperty float z\nproperty uchar red\nend_header\n"
        )
    };
    let lines = points.iter().map(|p| format!("{} {} {} 255\n", p.x, p.y, p.z));
    let text = header("ascii") + &lines.collect::<String>();
    let mut binary = header("binary_little_endian").into_bytes();
    for p in &points {
        p.as_vec3().to_array().iter().for_each(|v| binary.extend(v.to_le_bytes()));
        binary.push(255);
    }
    for bytes in [text.as_bytes(), &binary] {
        std::fs::write(&file, bytes).unwrap();
        let found = load(folder.path(), &LoadOptions::default()).unwrap();
        assert!(found.notes.is_empty() && found.points.len() == 100);
        let off = found.points.iter().zip(&points).map(|(a, b)| a.distance(*b));
        assert!(off.fold(0.0, f64::max) < 1e-6);
    }
    for length in [0, 30, 150, binary.len() / 2, binary.len() - 1] {
        std::fs::write(&file, &binary[..length]).unwrap();
        refused(folder.path(), &["sparse_pc.ply", "points"]);
    }
    let text = text.replace("property float y", "property float why");
    std::fs::write(&file, text).unwrap();
    refused(folder.path(), &["sparse_pc.ply", "vertices without y"]);
}

#[test]
fn reduced_copies_are_read_where_the_full_images_are_missing() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(9);
    write_photographs(&folder.path().join("images_4"), &all, [12, 10]);
    write_json(&folder.path().join("transforms.json"), &transforms(&all));
    let small: Vec<Camera> = all.iter().map(|c| resized(c, [12, 10])).collect();
    let found = assert_agrees_with_nerf(folder.path(), &small);
    assert!(found.notes[0].contains("images_4 are smaller"), "{:?}", found.notes);
    let mask = |name: &str, size: [u32; 2]| {
        std::fs::create_dir_all(folder.path().join(name)).unwrap();
        let white = image::GrayImage::from_pixel(size[0], size[1], image::Luma([255]));
        white.save(folder.path().join(name).join("003.png")).unwrap();
    };
    mask("masks", [WIDTH, HEIGHT]);
    let found = load(folder.path(), &LoadOptions::default()).unwrap();
    assert!(found.notes[1].ends_with("003.png has 48 x 40 pixels, and the photograph 12 x 10"));
    mask("masks_4", [12, 10]);
    let found = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!(in_order(&found)[3].coverage().unwrap().len(), 120);
    std::fs::remove_dir_all(folder.path().join("masks")).unwrap();
    // images_2 is before images_4; programs round odd sides down.
    write_photographs(&folder.path().join("images_2"), &all, [24, 19]);
    let small: Vec<Camera> = all.iter().map(|c| resized(c, [24, 19])).collect();
    assert_agrees_with_nerf(folder.path(), &small);
    std::fs::remove_dir_all(folder.path().join("images_2")).unwrap();
    write_photographs(&folder.path().join("images_2"), &all, [24, 24]);
    refused(folder.path(), &["images_2/000.png", "24 x 24", "aspect ratio of 48 x 40"]);
    let mut root = transforms(&all);
    root.as_object_mut().unwrap().remove("w");
    write_json(&folder.path().join("transforms.json"), &root);
    refused(folder.path(), &["transforms.json", "w:", "size of the full image"]);
}

#[test]
fn captures_of_polycam_and_record3d_agree_with_nerf() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(9);
    write_photographs(&folder.path().join("images"), &all, [WIDTH, HEIGHT]);
    let good = transforms(&all);
    let mut polycam = good.clone();
    polycam["orientation_override"] = json!("none");
    for key in ["fl_x", "fl_y", "cx", "cy", "w", "h"] {
        let value = polycam.as_object_mut().unwrap().remove(key).unwrap();
        for i in 0..9 {
            polycam["frames"][i][key] = value.clone();
            polycam["frames"][i]["file_path"] = json!(format!("./images/{i:03}.png"));
        }
    }
    let mut record3d = good;
    record3d["camera_model"] = json!("PERSPECTIVE");
    for i in 0..9 {
        for row in 0..4 {
            for column in 0..4 {
                // Poses in single precision.
                let value = &mut record3d["frames"][i]["transform_matrix"][row][column];
                *value = json!(f64::from(value.as_f64().unwrap() as f32));
            }
        }
    }
    for root in [polycam, record3d] {
        write_json(&folder.path().join("transforms.json"), &root);
        assert!(assert_agrees_with_nerf(folder.path(), &all).notes.is_empty());
    }
}
