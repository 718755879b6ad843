//! One small model, written as text and as binary and read back.

use std::path::Path;

use glam::{DQuat, DVec3};

use super::forms::resized;
use super::{assert_same_camera, ball, cameras, in_order, photograph, refused, world_to_camera};
use crate::{LoadOptions, load};
use film::write_image;
use render::Camera;

/// The number of image i. Image numbers have gaps, and do not have the order of the names.
fn image_number(i: usize) -> u32 {
    100 - 7 * i as u32
}

/// The world-to-camera quaternion (w, x, y, z) and translation.
fn pose(c: &Camera) -> ([f64; 4], [f64; 3]) {
    let (r, t) = world_to_camera(c);
    let q = DQuat::from_mat3(&r);
    ([q.w, q.x, q.y, q.z], t.to_array())
}

fn write_images(folder: &Path, cameras: &[Camera]) {
    std::fs::create_dir_all(folder.join("images")).unwrap();
    for (i, camera) in cameras.iter().enumerate() {
        write_image(&folder.join(format!("images/{i:02} a.png")), &photograph(camera)).unwrap();
    }
}

/// 200 points on the ball, and 50 far behind it.
fn points() -> Vec<DVec3> {
    let on_ball = (0..200).map(|i| {
        let (s, c) = (2.4 * f64::from(i)).sin_cos();
        let z = f64::from(i) / 100.0 - 0.995;
        ball().center
            + ball().radius * DVec3::new(c * (1.0 - z * z).sqrt(), s * (1.0 - z * z).sqrt(), z)
    });
    on_ball.chain((0..50).map(|i| DVec3::new(9.0, f64::from(i), 5.0))).collect()
}

/// The error of a point, and the number of images that see it. The sixth part is sure.
fn track(i: usize) -> (f64, usize) {
    (if i.is_multiple_of(3) { 0.4 } else { 0.9 }, 2 + i % 4)
}

/// Whether each point is sure.
fn is_sure() -> Vec<bool> {
    (0..250).map(|i: usize| i.is_multiple_of(3) && i % 4 >= 2).collect()
}

pub(super) fn write_text(folder: &Path, cameras: &[Camera], model: &str, parameters: &[f64]) {
    std::fs::create_dir_all(folder).unwrap();
    let numbers = |v: &[f64]| v.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let size = (cameras[0].width, cameras[0].height);
    let text = format!("# Camera list\n5 {model} {} {} {}\n", size.0, size.1, numbers(parameters));
    std::fs::write(folder.join("cameras.txt"), text).unwrap();
    let mut text = "# Image list with two lines of data per image\n".to_owned();
    for (i, camera) in cameras.iter().enumerate().rev() {
        let (q, t) = pose(camera);
        // The line of image points may be empty.
        let seen = if i % 2 == 0 { "2362.39 248.498 58396 1784.7 268.254 -1" } else { "" };
        text += &format!(
            "{} {} {} 5 {i:02} a.png\n{seen}\n",
            image_number(i),
            numbers(&q),
            numbers(&t)
        );
    }
    std::fs::write(folder.join("images.txt"), text).unwrap();
    let lines = points()
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let (error, views) = track(i);
            format!("{i} {} 1 2 3 {error}{}\n", numbers(&p.to_array()), " 1 2".repeat(views))
        })
        .collect::<String>();
    std::fs::write(folder.join("points3D.txt"), lines).unwrap();
}

fn put(bytes: &mut Vec<u8>, values: &[f64]) {
    values.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
}

fn write_binary(folder: &Path, cameras: &[Camera], model: u32, parameters: &[f64]) {
    std::fs::create_dir_all(folder).unwrap();
    let mut bytes = 1u64.to_le_bytes().to_vec();
    bytes.extend(5u32.to_le_bytes());
    bytes.extend(model.to_le_bytes());
    bytes.extend(u64::from(cameras[0].width).to_le_bytes());
    bytes.extend(u64::from(cameras[0].height).to_le_bytes());
    put(&mut bytes, parameters);
    std::fs::write(folder.join("cameras.bin"), bytes).unwrap();
    let mut bytes = (cameras.len() as u64).to_le_bytes().to_vec();
    for (i, camera) in cameras.iter().enumerate().rev() {
        let (q, t) = pose(camera);
        bytes.extend(image_number(i).to_le_bytes());
        put(&mut bytes, &q);
        put(&mut bytes, &t);
        bytes.extend(5u32.to_le_bytes());
        bytes.extend(format!("{i:02} a.png\0").bytes());
        bytes.extend((i as u64).to_le_bytes());
        for k in 0..i {
            put(&mut bytes, &[1.5, 2.5]);
            bytes.extend((k as i64 - 1).to_le_bytes());
        }
    }
    std::fs::write(folder.join("images.bin"), bytes).unwrap();
    let mut bytes = (points().len() as u64).to_le_bytes().to_vec();
    for (i, point) in points().iter().enumerate() {
        bytes.extend((i as u64).to_le_bytes());
        put(&mut bytes, &point.to_array());
        bytes.extend([1, 2, 3]);
        let (error, views) = track(i);
        put(&mut bytes, &[error]);
        bytes.extend((views as u64).to_le_bytes());
        bytes.resize(bytes.len() + 8 * views, 0);
    }
    std::fs::write(folder.join("points3D.bin"), bytes).unwrap();
}

fn pinhole_of(c: &Camera) -> [f64; 4] {
    [c.focal.x, c.focal.y, c.principal.x, c.principal.y]
}

#[test]
fn text_and_binary_models_are_read_from_every_folder() {
    let all = cameras(9);
    for place in ["sparse/0", "sparse", "colmap/sparse/0", "."] {
        for binary in [false, true] {
            let folder = tempfile::tempdir().unwrap();
            write_images(folder.path(), &all);
            let model = folder.path().join(place);
            if binary {
                write_binary(&model, &all, 1, &pinhole_of(&all[0]));
            } else {
                write_text(&model, &all, "PINHOLE", &pinhole_of(&all[0]));
            }
            for path in [folder.path(), &model] {
                let dataset = load(path, &LoadOptions::default()).unwrap();
                assert!(
                    dataset.format.contains(if binary { "binary" } else { "text" }),
                    "{}",
                    dataset.format
                );
                assert_eq!(dataset.points.len(), 250);
                assert_eq!(dataset.is_sure, is_sure());
                assert_eq!(dataset.sure_points().count(), 42);
                for (i, view) in in_order(&dataset).into_iter().enumerate() {
                    assert_eq!(view.name, format!("{i:02} a.png"));
                    assert_same_camera(&view.camera, &all[i], 1e-9);
                }
            }
        }
    }
}

#[test]
fn camera_models_with_distortion_become_pinholes() {
    let all = cameras(3);
    let c = &all[0];
    let (f, x, y) = (c.focal.x, c.principal.x, c.principal.y);
    let models = [
        ("SIMPLE_PINHOLE", 0, vec![f, x, y], true),
        ("SIMPLE_RADIAL", 2, vec![f, x, y, 0.4], false),
        ("RADIAL", 3, vec![f, x, y, 0.2, 0.1], false),
        ("OPENCV", 4, vec![f, f, x, y, 0.2, 0.1, 0.01, 0.0], false),
    ];
    for (name, number, parameters, plain) in models {
        let folder = tempfile::tempdir().unwrap();
        write_images(folder.path(), &all);
        write_text(&folder.path().join("sparse"), &all, name, &parameters);
        let text = load(folder.path(), &LoadOptions::default()).unwrap();
        write_binary(&folder.path().join("sparse"), &all, number, &parameters);
        let binary = load(folder.path(), &LoadOptions::default()).unwrap();
        assert_eq!(text.train[0].image, binary.train[0].image, "{name}");
        assert_eq!(text.train[0].camera, binary.train[0].camera, "{name}");
        assert_eq!(text.train[0].camera.focal.x == f, plain, "{name}");
    }
}

#[test]
fn wrong_text_models_are_refused() {
    let all = cameras(3);
    let folder = tempfile::tempdir().unwrap();
    write_images(folder.path(), &all);
    write_text(folder.path(), &all, "FOV", &[1.0; 5]);
    refused(folder.path(), &["cameras.txt", "camera 5 model", "found FOV", "OPENCV"]);
    write_text(folder.path(), &all, "PINHOLE", &[1.0; 3]);
    refused(folder.path(), &["camera 5", "3 parameters of PINHOLE"]);
    write_text(folder.path(), &all, "SIMPLE_PINHOLE", &[0.0, 1.0, 1.0]);
    refused(folder.path(), &["camera 5", "focal lengths above 0"]);
    write_text(folder.path(), &all, "PINHOLE", &pinhole_of(&all[0]));
    let images = folder.path().join("images.txt");
    let good = std::fs::read_to_string(&images).unwrap();
    let (q, _) = pose(&all[2]);
    let cases = [
        (good.replace(&q[0].to_string(), "9"), vec!["images.txt", "02 a.png", "unit quaternion"]),
        (good.replace(&q[0].to_string(), "x"), vec!["line 2", "found x", "a quaternion"]),
        (good.replace("5 02 a", "6 02 a"), vec!["02 a.png", "camera 6"]),
        (good.replace(" a.png", " b.png"), vec!["3 of 3 missing", "no such file", "0 b.png"]),
        (good.replace("02 a.png", ""), vec!["line 2", "an image's name"]),
        ("# none\n".to_owned(), vec!["images", "none"]),
    ];
    for (text, words) in cases {
        std::fs::write(&images, text).unwrap();
        refused(folder.path(), &words);
    }
    std::fs::remove_file(&images).unwrap();
    refused(folder.path(), &["images.txt"]);
}

#[test]
fn binary_models_truncated_at_any_byte_are_refused() {
    let all = cameras(3);
    let folder = tempfile::tempdir().unwrap();
    write_images(folder.path(), &all);
    write_binary(folder.path(), &all, 7, &[1.0; 5]);
    refused(folder.path(), &["cameras.bin", "camera 5 model", "found FOV"]);
    write_binary(folder.path(), &all, 99, &[1.0; 5]);
    refused(folder.path(), &["cameras.bin", "found 99"]);
    write_binary(folder.path(), &all, 1, &pinhole_of(&all[0]));
    for name in ["cameras.bin", "images.bin", "points3D.bin"] {
        let path = folder.path().join(name);
        let whole = std::fs::read(&path).unwrap();
        for length in (0..whole.len()).step_by(13) {
            std::fs::write(&path, &whole[..length]).unwrap();
            refused(folder.path(), &[name, "the file's end at byte"]);
        }
        // A count that does not fit in memory.
        let mut wrong_count = whole.clone();
        wrong_count[..8].fill(0xff);
        std::fs::write(&path, &wrong_count).unwrap();
        refused(folder.path(), &[name]);
        std::fs::write(&path, &whole).unwrap();
    }
    std::fs::remove_dir_all(folder.path().join("images")).unwrap();
    refused(folder.path(), &["images", "no such folder"]);
}

#[test]
fn the_model_with_the_most_images_is_read() {
    let all = cameras(9);
    let folder = tempfile::tempdir().unwrap();
    write_images(folder.path(), &all);
    let model = |i: usize| folder.path().join(format!("sparse/{i}"));
    write_text(&model(0), &all[..2], "PINHOLE", &pinhole_of(&all[0]));
    write_binary(&model(10), &all, 1, &pinhole_of(&all[0]));
    write_text(&model(2), &all[..3], "PINHOLE", &pinhole_of(&all[0]));
    for path in [folder.path().to_owned(), folder.path().join("sparse")] {
        let dataset = load(&path, &LoadOptions::default()).unwrap();
        assert_eq!(dataset.train.len() + dataset.test.len(), 9);
        let note = &dataset.notes[0];
        let prefix = if path.ends_with("sparse") { "" } else { "sparse/" };
        let start = format!("{prefix}10 with 9 images is read; {prefix}0 has 2, {prefix}2 has 3");
        assert!(note.starts_with(&start), "{note}");
    }
    let small = load(&model(2), &LoadOptions::default()).unwrap();
    assert_eq!((small.train.len() + small.test.len(), small.notes.len()), (3, 0));
    std::fs::write(model(0).join("images.txt"), "x").unwrap();
    refused(folder.path(), &["sparse/0/images.txt", "line 1"]);
}

#[test]
fn other_image_folders_are_read() {
    let all = cameras(9);
    let folder = tempfile::tempdir().unwrap();
    write_images(folder.path(), &all);
    write_text(&folder.path().join("sparse/0"), &all, "PINHOLE", &pinhole_of(&all[0]));
    let at = |name: &str| folder.path().join(name);
    std::fs::rename(at("images"), at("input")).unwrap();
    // A folder without the photographs of the model is passed over.
    std::fs::create_dir(at("images")).unwrap();
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_same_camera(&in_order(&dataset)[3].camera, &all[3], 1e-9);
    assert!(dataset.notes.is_empty(), "{:?}", dataset.notes);
    // HEIC photographs were converted after COLMAP had seen them.
    let model = at("sparse/0/images.txt");
    let text = std::fs::read_to_string(&model).unwrap();
    std::fs::write(&model, text.replace(".png", ".HEIC")).unwrap();
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!((dataset.train.len(), dataset.notes.len()), (9, 0));
    std::fs::write(&model, text).unwrap();
    std::fs::remove_dir_all(at("input")).unwrap();
    std::fs::create_dir(at("images_2")).unwrap();
    for (i, camera) in all.iter().enumerate().filter(|(i, _)| *i != 4) {
        let film = photograph(&resized(camera, [24, 20]));
        write_image(&at(&format!("images_2/{i:02} a.png")), &film).unwrap();
    }
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_same_camera(&in_order(&dataset)[3].camera, &resized(&all[3], [24, 20]), 1e-9);
    assert_eq!(dataset.notes[0], "1 of 9 images is missing and left out: images_2/04 a.png");
    assert!(dataset.notes[1].contains("images_2 are smaller"), "{:?}", dataset.notes);
}
