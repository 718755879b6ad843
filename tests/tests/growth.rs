//! The growth of a bounding sphere that cuts the object off.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;
use std::path::Path;
use std::process::Command;

use film::Film;
use glam::{DVec2, DVec3};
use render::Camera;
use serde_json::{Value, json};

/// The pixels along a side of a photograph.
const SIDE: u32 = 48;

/// The radius of a ball with a pattern, around the origin. The films show a part of 0.9 around.
const BALL: f64 = 1.6;

/// Eight views of the ball from one side, in a data set without points and without a sphere.
fn ball(folder: &Path) {
    let frame = |i: u32| {
        let angle = 0.3 * f64::from(i) - 1.05;
        let eye = DVec3::new(6.0 * angle.sin(), 0.6 * f64::from(i % 3) - 0.6, 6.0 * angle.cos());
        let (focal, middle) = (DVec2::splat(5.0 * f64::from(SIDE) / 2.0), f64::from(SIDE) / 2.0);
        let (target, up) = (DVec3::new(0.0, 0.0, 1.0), DVec3::Y);
        let middle = DVec2::splat(middle);
        let camera = Camera::look_at(SIDE, SIDE, focal, middle, eye, target, up).unwrap();
        let name = format!("{i}.png");
        film::write_image(&folder.join(&name), &photograph(&camera)).unwrap();
        let pose = camera.pose().transpose().to_cols_array_2d();
        (focal.x, json!({"file_path": name, "transform_matrix": pose}))
    };
    let (focal, frames): (Vec<f64>, Vec<Value>) = (0..8).map(frame).unzip();
    let file = json!({"fl_x": focal[0], "fl_y": focal[0], "cx": SIDE / 2, "cy": SIDE / 2,
                      "w": SIDE, "h": SIDE, "frames": frames});
    fs::write(folder.join("transforms.json"), file.to_string()).unwrap();
}

fn photograph(camera: &Camera) -> Film {
    let mut image = Film::new(SIDE, SIDE);
    for (k, pixel) in image.pixels.iter_mut().enumerate() {
        let u = DVec2::new(f64::from(k as u32 % SIDE) + 0.5, f64::from(k as u32 / SIDE) + 0.5);
        let d = camera.direction(u).normalize();
        let (along, apart) = (camera.eye.dot(d), camera.eye.length_squared() - BALL * BALL);
        let x = camera.eye + d * (-along - (along * along - apart).max(0.0).sqrt());
        let wave = (9.0 * x.x + 1.5 * (5.0 * x.y).sin()).sin() * (7.0 * x.y - 2.0 * x.x).cos();
        *pixel = [0.4 + 0.3 * wave as f32, 0.3, 0.2];
    }
    image
}

/// Fits the ball, and returns standard error, the bounding radius and the model.
fn fit(data: &Path, run: &Path, options: &[&str]) -> (String, f64, Vec<u8>) {
    let output = Command::new(tests::binary())
        .args(["fit", data.to_str().unwrap(), "-o", run.to_str().unwrap()])
        .args(["--iterations", "200", "--batch", "64", "--background", "volume"])
        .args(options)
        .output()
        .unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{text}");
    (text, radius(run), fs::read(run.join("model.safetensors")).unwrap())
}

/// The radius in `fit.toml`.
fn radius(run: &Path) -> f64 {
    let file: toml::Table = fs::read_to_string(run.join("fit.toml")).unwrap().parse().unwrap();
    file["bounds"].as_array().unwrap()[3].as_float().unwrap()
}

#[test]
fn a_fit_begins_again_in_a_larger_sphere_if_the_first_one_cuts_the_object_off() {
    let folder = tempfile::tempdir().unwrap();
    ball(folder.path());
    let run = |name: &str, options: &[&str]| fit(folder.path(), &folder.path().join(name), options);
    let parts = folder.path().join("parts");
    let (_, first, _) = run("parts", &["--stop-after", "40"]);
    let (text, grown, model) = run("one", &["--threads", "1"]);
    println!("{text}");
    assert!(text.contains("ends on it, so the fit begins again with a radius of"), "{text}");
    assert!(grown > 1.39 * first && grown < 1.97 * first, "from {first} to {grown}");
    // A resumed run grows as well, and has the same bits, before and behind the growth.
    let resume = |options: &[&str]| {
        tests::dsdf_ok(&[&["fit", "--resume", "-o", parts.to_str().unwrap()], options].concat())
    };
    resume(&["--stop-after", "120", "--threads", "2"]);
    resume(&[]);
    assert_eq!(radius(&parts), grown);
    assert!(fs::read(parts.join("model.safetensors")).unwrap() == model, "other bits");
    // Nobody asks about a sphere that was asked for.
    let asked = format!("0,0,1,{first}");
    let (text, kept, _) = run("asked", &["--bounds", &asked]);
    assert!(kept == first && !text.contains("begins again"), "{text}");
}
