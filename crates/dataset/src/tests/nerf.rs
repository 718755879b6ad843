//! NeRF/Blender and nerfstudio camera files.

use super::*;

#[test]
fn data_sets_are_read_with_their_own_split() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(6);
    write_nerf(folder.path(), "transforms_train.json", &all[..4]);
    write_nerf(folder.path(), "transforms_val.json", &all[4..5]);
    for path in [folder.path().to_owned(), folder.path().join("transforms_train.json")] {
        let dataset = load(&path, &LoadOptions::default()).unwrap();
        assert_eq!((dataset.train.len(), dataset.test.len()), (4, 1));
        for (view, camera) in dataset.train.iter().chain(&dataset.test).zip(&all) {
            assert_same_camera(&view.camera, camera, 1e-12);
        }
    }
    // transforms_test.json has precedence over transforms_val.json.
    write_nerf(folder.path(), "transforms_test.json", &all[4..]);
    assert_eq!(load(folder.path(), &LoadOptions::default()).unwrap().test.len(), 2);
}

#[test]
fn without_held_out_images_the_usual_split_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let all = cameras(31);
    write_nerf(folder.path(), "transforms_train.json", &all[..20]);
    write_nerf(folder.path(), "transforms_test.json", &all[20..]);
    for i in 0..11 {
        std::fs::remove_file(folder.path().join(format!("transforms_test_{i}.png"))).unwrap();
    }
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!((dataset.train.len(), dataset.test.len()), (17, 3));
    assert!(dataset.notes[0].starts_with("11 of 31 images are missing"), "{:?}", dataset.notes);
}

#[test]
fn names_outside_the_folder_and_converted_images_are_found_and_are_no_masks() {
    let folder = tempfile::tempdir().unwrap();
    let mut root = write_nerf(folder.path(), "transforms.json", &cameras(3));
    std::fs::create_dir(folder.path().join("masks")).unwrap();
    std::fs::create_dir(folder.path().join("other")).unwrap();
    let path = folder.path().join("transforms_0.png");
    let outside = "other/../transforms_1.HEIC";
    for (i, name) in [path.to_str().unwrap(), outside, "transforms_2.JPG"].iter().enumerate() {
        root["frames"][i]["file_path"] = json!(name);
    }
    // A photograph that was converted stays beside its copy.
    std::fs::write(folder.path().join("transforms_1.HEIC"), "\0\0\0\x18ftypheic").unwrap();
    write_json(&folder.path().join("transforms.json"), &root);
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!((dataset.train.len(), dataset.test.len()), (3, 0));
    let views = || dataset.train.iter().chain(&dataset.test);
    assert!(views().all(|view| view.mask.is_none()), "a photograph is no mask");
    std::fs::copy(&path, folder.path().join("masks/transforms_1.png")).unwrap();
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    assert!(dataset.train[1].mask.is_some() && dataset.train[2].mask.is_none());
}

#[test]
fn focal_length_and_principal_point_have_defaults() {
    let folder = tempfile::tempdir().unwrap();
    let mut root = write_nerf(folder.path(), "transforms.json", &cameras(9));
    for key in ["fl_x", "fl_y", "cx", "cy", "w", "h"] {
        root.as_object_mut().unwrap().remove(key);
    }
    root["camera_angle_x"] = json!(0.6);
    write_json(&folder.path().join("transforms.json"), &root);
    let dataset = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!((dataset.train.len(), dataset.test.len()), (9, 0));
    let camera = dataset.train[0].camera;
    assert_relative_eq!(camera.focal, DVec2::splat(24.0 / 0.3f64.tan()), epsilon = 1e-12);
    assert_eq!(camera.principal, DVec2::new(24.0, 20.0));
}

#[test]
fn a_field_of_view_is_an_angle_up_to_pi() {
    let folder = tempfile::tempdir().unwrap();
    let mut by_angle = write_nerf(folder.path(), "transforms.json", &cameras(3));
    let path = folder.path().join("transforms.json");
    for key in ["fl_x", "fl_y"] {
        by_angle.as_object_mut().unwrap().remove(key);
    }
    for (key, angle, found) in [("x", 7.0, "found 7,"), ("x", 1e-300, "1e-300"), ("y", 0.0, "0,")] {
        by_angle["camera_angle_x"] = json!(0.6);
        by_angle[format!("camera_angle_{key}")] = json!(angle);
        write_json(&path, &by_angle);
        refused(&path, &[key, found, "expected an angle from 1e-6 to pi"]);
    }
}

#[test]
fn an_error_names_the_place_in_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let good = write_nerf(folder.path(), "transforms.json", &cameras(3));
    let path = folder.path().join("transforms.json");
    let with = |pointer: &str, value: Value| {
        let mut root = good.clone();
        match root.pointer_mut(pointer) {
            Some(place) => *place = value,
            None => root[&pointer[1..]] = value,
        }
        write_json(&path, &root);
    };
    let cases = [
        ("/frames", json!([]), vec!["frames", "found []"]),
        ("/frames", json!(3), vec!["frames", "found 3"]),
        ("/frames/1/file_path", json!(7), vec!["frames/1/file_path", "found 7"]),
        (
            "/frames/2/transform_matrix",
            json!([[1, 2], [3, 4]]),
            vec!["frames/2/transform_matrix", "4 x 4"],
        ),
        (
            "/frames/2/transform_matrix/0/0",
            json!("x"),
            vec!["frames/2/transform_matrix", "finite numbers"],
        ),
        (
            "/frames/2/transform_matrix/0/0",
            json!(9),
            vec!["frames/2/transform_matrix", "determinant", "rotation"],
        ),
        (
            "/frames/2/transform_matrix/3",
            json!([1, 2, 3, 1]),
            vec!["frames/2/transform_matrix", "last row"],
        ),
        (
            "/w",
            json!(50),
            vec![
                "transforms_0.png",
                "found 48 x 40",
                "aspect ratio of 50 x 40 (from transforms.json)",
            ],
        ),
        ("/w", json!(-48), vec!["w:", "found -48"]),
        ("/w", json!("wide"), vec!["w:", "found \"wide\"", "a finite number"]),
        ("/fl_x", json!(0), vec!["fl_x", "focal lengths 0"]),
        ("/camera_model", json!("EQUIRECTANGULAR"), vec!["camera_model", "EQUIRECTANGULAR"]),
        ("/k3", json!("0.1"), vec!["k3", "found \"0.1\""]),
        ("/applied_transform", json!([[1, 2], [3, 4]]), vec!["applied_transform", "3 x 4"]),
        ("/applied_scale", json!(0), vec!["applied_scale", "a number above 0"]),
        ("/ply_file_path", json!(5), vec!["ply_file_path", "found 5"]),
        ("/train_filenames", json!(["none.png"]), vec!["train_filenames/0", "none.png"]),
        ("/val_filenames", json!([4]), vec!["val_filenames", "array of file names"]),
        ("/k1", json!(-40), vec!["distortion"]),
    ];
    for (pointer, value, words) in cases {
        with(pointer, value);
        refused(&path, &words);
    }
}

#[test]
fn numbers_that_are_not_finite_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    std::fs::write(&path, "{\"frames\": [\n  {\"file_path\": NaN}]}").unwrap();
    refused(&path, &["transforms.json", "frames/0/file_path", "found \"NaN\""]);
    std::fs::write(&path, "{\"frames\": [{\"a\": 1e999}]}").unwrap();
    refused(&path, &["line 1 column"]);
}
