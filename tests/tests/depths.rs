//! Depths of photographs that guide a fit.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;
use std::path::Path;
use std::process::Command;

use film::Film;
use glam::{DMat4, DQuat, DVec2, DVec3};
use random::{Name, Stream};
use render::Camera;
use serde_json::{Value, json};

/// The views of a wall.
const VIEWS: u32 = 6;

const AXES: Name = Name::new("axes of turns", 1 << 32);

/// Six views of a wall through the origin with a pattern, as a data set of pictures of `side`
/// pixels. The cameras of the data set are turned by `degrees` about random axes. Returns the
/// rotations of the true ones.
fn wall(folder: &Path, side: u32, degrees: f64) -> Vec<DQuat> {
    let cameras: Vec<Camera> = (0..VIEWS).map(|i| camera(side, i)).collect();
    let frame = |(i, camera): (u64, &Camera)| {
        let name = format!("{i}.png");
        film::write_image(&folder.join(&name), &photograph(camera)).unwrap();
        let axis = DVec3::from(Stream::of_seed(2).named(AXES).at(i).in_ball()).normalize();
        let turn = DMat4::from_quat(DQuat::from_axis_angle(axis, degrees.to_radians()));
        let pose = DMat4 { w_axis: camera.eye.extend(1.0), ..turn * camera.pose() };
        json!({"file_path": name, "transform_matrix": pose.transpose().to_cols_array_2d()})
    };
    let frames: Vec<Value> = (0..).zip(&cameras).map(frame).collect();
    let (focal, middle) = (cameras[0].focal.x, cameras[0].principal.x);
    let file = json!({"fl_x": focal, "fl_y": focal, "cx": middle, "cy": middle, "w": side,
                      "h": side, "frames": frames});
    fs::write(folder.join("transforms.json"), file.to_string()).unwrap();
    cameras.iter().map(|camera| DQuat::from_mat4(&camera.pose())).collect()
}

fn camera(side: u32, i: u32) -> Camera {
    let angle = 0.15 * f64::from(i) - 0.4;
    let eye = DVec3::new(4.0 * angle.sin(), 0.3 * f64::from(i % 2), 4.0 * angle.cos());
    let (focal, middle) = (DVec2::splat(70.0 / 48.0 * f64::from(side)), f64::from(side) / 2.0);
    Camera::look_at(side, side, focal, DVec2::splat(middle), eye, DVec3::ZERO, DVec3::Y).unwrap()
}

fn photograph(camera: &Camera) -> Film {
    let Camera { width, height, eye, .. } = *camera;
    let mut image = Film::new(width, height);
    for (k, pixel) in image.pixels.iter_mut().enumerate() {
        let u = DVec2::new(f64::from(k as u32 % width) + 0.5, f64::from(k as u32 / width) + 0.5);
        let d = camera.direction(u);
        let x = eye - d * (eye.z / d.z);
        let wave = (9.0 * x.x + 1.5 * (5.0 * x.y).sin()).sin() * (7.0 * x.y - 2.0 * x.x).cos();
        *pixel = [0.4 + 0.3 * wave as f32, 0.3, 0.2];
    }
    image
}

/// Fits the wall, and returns standard error and the model.
fn fit(data: &Path, run: &Path, options: &[&str]) -> (String, Vec<u8>) {
    let output = Command::new(tests::binary())
        .args(["fit", data.to_str().unwrap(), "-o", run.to_str().unwrap()])
        .args(["--iterations", "60", "--batch", "64", "--bounds", "0,0,0,1"])
        .args(options)
        .output()
        .unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{text}");
    (text, fs::read(run.join("model.safetensors")).unwrap())
}

#[test]
fn depths_are_found_before_a_trained_background_and_said() {
    let folder = tempfile::tempdir().unwrap();
    wall(folder.path(), 48, 0.0);
    let run = |name: &str, options: &[&str]| fit(folder.path(), &folder.path().join(name), options);
    let (text, model) = run("one", &["--background", "volume", "--threads", "1"]);
    let known = text.lines().find_map(|line| line.strip_prefix("depths: known at "));
    let known = known.and_then(|rest| rest.split(' ').next()?.parse::<f64>().ok());
    // The bounding sphere covers two fifths of the film.
    assert!(known.is_some_and(|known| known > 20.0), "{text}");
    // The search is repeated by a resumed run.
    let parts = folder.path().join("parts");
    let (_, first) = fit(folder.path(), &parts, &["--background", "volume", "--stop-after", "20"]);
    tests::dsdf_ok(&["fit", "--resume", "-o", parts.to_str().unwrap()]);
    let resumed = fs::read(parts.join("model.safetensors")).unwrap();
    assert!(first != model && resumed == model, "other bits after a resumption");
    let (_, again) = run("two", &["--background", "volume", "--threads", "3"]);
    assert!(model == again, "other bits on three threads");
    let (text, other) = run("none", &["--background", "volume", "--stereo", "none"]);
    assert!(!text.contains("depths: known") && other != model, "{text}");
    // A wall before one colour can lose its surface. The search comes before the first iteration.
    let first = ["--background", "constant", "--stop-after", "1"];
    let (text, _) = run("constant", &first);
    assert!(!text.contains("depths: known"), "{text}");
    let (text, _) = run("use", &[&first[..], &["--stereo", "use"]].concat());
    assert!(text.contains("depths: known"), "{text}");
}

/// The mean angle, in degrees, by which the rotations from the first view in `cameras.json` to the
/// others differ from the true ones.
fn rotation_error(run: &Path, truth: &[DQuat]) -> f64 {
    let text = fs::read_to_string(run.join("cameras.json")).unwrap();
    let file: Value = serde_json::from_str(&text).unwrap();
    let of = |view: &Value| {
        let rows: [[f64; 4]; 4] = serde_json::from_value(view["pose"].clone()).unwrap();
        let name = view["name"].as_str().unwrap();
        let number: usize = name.trim_end_matches(".png").parse().unwrap();
        (DQuat::from_mat4(&DMat4::from_cols_array_2d(&rows).transpose()), truth[number])
    };
    let all: Vec<(DQuat, DQuat)> = file["views"].as_array().unwrap().iter().map(of).collect();
    let first = all[0];
    let angle = |(found, truth): &(DQuat, DQuat)| {
        (first.0.inverse() * *found).angle_between(first.1.inverse() * *truth).to_degrees()
    };
    all.iter().skip(1).map(angle).sum::<f64>() / (all.len() - 1) as f64
}

#[test]
fn places_of_points_adjust_wrong_cameras_and_leave_right_ones() {
    let folder = tempfile::tempdir().unwrap();
    let [wrong, right] = ["wrong", "right"].map(|name| folder.path().join(name));
    for data in [&wrong, &right] {
        fs::create_dir(data).unwrap();
    }
    let truth = wall(&wrong, 96, 0.5);
    wall(&right, 96, 0.0);
    let (run, options) = (folder.path().join("run"), ["--background", "volume"]);
    let (text, model) = fit(&wrong, &run, &options);
    assert!(text.contains("cameras: adjusted"), "{text}");
    let error = rotation_error(&run, &truth);
    println!("{error}");
    assert!(error < 0.25, "{error} degrees");
    // A resumed run has the same cameras and the same bits.
    let parts = folder.path().join("parts");
    fit(&wrong, &parts, &["--background", "volume", "--stop-after", "20"]);
    tests::dsdf_ok(&["fit", "--resume", "-o", parts.to_str().unwrap()]);
    assert_eq!(
        fs::read(parts.join("cameras.json")).unwrap(),
        fs::read(run.join("cameras.json")).unwrap()
    );
    assert!(fs::read(parts.join("model.safetensors")).unwrap() == model);
    let (text, _) = fit(&right, &folder.path().join("kept"), &options);
    assert!(text.contains("cameras: not adjusted before the fit"), "{text}");
    assert!(!folder.path().join("kept/cameras.json").exists());
    let none = ["--background", "volume", "--refine-cameras", "none"];
    let (text, _) = fit(&wrong, &folder.path().join("none"), &none);
    assert!(!text.contains("cameras:"), "{text}");
}
