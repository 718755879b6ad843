//! Depths of photographs that guide a fit.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;
use std::path::Path;
use std::process::Command;

use film::Film;
use glam::{DVec2, DVec3};
use render::Camera;
use serde_json::{Value, json};

const SIDE: u32 = 48;

/// Six views of a wall through the origin with a pattern, as a data set.
fn wall(folder: &Path) {
    let frames: Vec<Value> = (0..6).map(|i| view(folder, i)).collect();
    let focal = 70.0;
    let middle = f64::from(SIDE) / 2.0;
    let file = json!({"fl_x": focal, "fl_y": focal, "cx": middle, "cy": middle, "w": SIDE,
                      "h": SIDE, "frames": frames});
    fs::write(folder.join("transforms.json"), file.to_string()).unwrap();
}

/// Writes a view's photograph, and returns its frame.
fn view(folder: &Path, i: u32) -> Value {
    let angle = 0.15 * f64::from(i) - 0.4;
    let eye = DVec3::new(4.0 * angle.sin(), 0.3 * f64::from(i % 2), 4.0 * angle.cos());
    let middle = DVec2::splat(f64::from(SIDE) / 2.0);
    let camera =
        Camera::look_at(SIDE, SIDE, DVec2::splat(70.0), middle, eye, DVec3::ZERO, DVec3::Y);
    let camera = camera.unwrap();
    let mut image = Film::new(SIDE, SIDE);
    for (k, pixel) in image.pixels.iter_mut().enumerate() {
        let u = DVec2::new(f64::from(k as u32 % SIDE) + 0.5, f64::from(k as u32 / SIDE) + 0.5);
        let d = camera.direction(u);
        let x = eye - d * (eye.z / d.z);
        let wave = (9.0 * x.x + 1.5 * (5.0 * x.y).sin()).sin() * (7.0 * x.y - 2.0 * x.x).cos();
        *pixel = [0.4 + 0.3 * wave as f32, 0.3, 0.2];
    }
    let name = format!("{i}.png");
    io::write_image(&folder.join(&name), &image).unwrap();
    let pose = camera.pose().transpose().to_cols_array_2d();
    json!({"file_path": name, "transform_matrix": pose})
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
    wall(folder.path());
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
    let (text, _) = run("constant", &["--background", "constant"]);
    assert!(!text.contains("depths: known"), "{text}");
    let (text, _) = run("use", &["--background", "constant", "--stereo", "use"]);
    assert!(text.contains("depths: known"), "{text}");
}
