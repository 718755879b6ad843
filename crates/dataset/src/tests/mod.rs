//! Small data sets in every format, written and read back, and wrong ones that must be refused.

mod colmap;
mod forms;
mod images;
mod kinds;
mod lenses;
mod middlebury;
mod nerf;
mod nerfstudio;
mod neus;

use std::path::Path;

use approx::assert_relative_eq;
use field::Sphere;
use files::InputError;
use film::Film;
use film::write_image;
use glam::{DMat3, DMat4, DVec2, DVec3};
use render::Camera;
use serde_json::{Value, json};

use super::*;

pub(crate) const WIDTH: u32 = 48;
pub(crate) const HEIGHT: u32 = 40;
const BACKGROUND: [f32; 3] = [0.05, 0.1, 0.2];

/// The object of every data set here.
pub(crate) fn ball() -> Sphere<f64> {
    Sphere { center: DVec3::new(0.2, -0.1, 0.3), radius: 0.5 }
}

/// Cameras all around the ball, aimed at points up to 0.07 from its centre.
pub(crate) fn cameras(count: usize) -> Vec<Camera> {
    let (focal, principal) = (DVec2::new(90.0, 88.0), DVec2::new(23.0, 21.5));
    (0..count)
        .map(|i| {
            let (azimuth, height) = (2.4 * i as f64, (1.7 * i as f64).sin());
            let eye =
                ball().center + 3.0 * DVec3::new(azimuth.cos(), azimuth.sin(), height).normalize();
            let target =
                ball().center + 0.05 * DVec3::new((3.0 * azimuth).sin(), azimuth.cos(), 0.0);
            Camera::look_at(WIDTH, HEIGHT, focal, principal, eye, target, DVec3::Z).unwrap()
        })
        .collect()
}

/// An image of the ball, brighter than the background, coloured by its normal.
pub(crate) fn photograph(camera: &Camera) -> Film {
    let mut film = Film::new(camera.width, camera.height);
    for (i, pixel) in film.pixels.iter_mut().enumerate() {
        let u = DVec2::new(
            f64::from(i as u32 % camera.width) + 0.5,
            f64::from(i as u32 / camera.width) + 0.5,
        );
        let direction = camera.direction(u);
        *pixel = match ball().clip(camera.eye, direction) {
            Some((t, _)) => {
                let n = (camera.eye + direction * t - ball().center) / ball().radius;
                (n * 0.3 + 0.6).as_vec3().to_array()
            }
            None => BACKGROUND,
        };
    }
    film
}

pub(crate) fn assert_same_camera(found: &Camera, expected: &Camera, tolerance: f64) {
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    assert_relative_eq!(found.focal, expected.focal, max_relative = tolerance);
    assert_relative_eq!(found.principal, expected.principal, epsilon = 100.0 * tolerance);
    for (a, b) in [
        (found.eye, expected.eye),
        (found.right, expected.right),
        (found.up, expected.up),
        (found.forward, expected.forward),
    ] {
        assert_relative_eq!(a, b, epsilon = 10.0 * tolerance);
    }
}

/// Checks that a data set is refused as wrong input, on one line, with these words.
pub(crate) fn refused(path: &Path, words: &[&str]) {
    let Err(error): Result<_, InputError> = load(path, &LoadOptions::default()) else {
        panic!("this data set must be refused: {}", path.display());
    };
    let text = error.to_string();
    assert!(!text.contains('\n'), "{text}");
    for word in words {
        assert!(text.contains(word), "no {word:?} in: {text}");
    }
}

fn rows(m: DMat4) -> Vec<[f64; 4]> {
    m.transpose().to_cols_array_2d().to_vec()
}

/// Writes `file`, for example `transforms_train.json`, and its images; returns the JSON.
fn write_nerf(folder: &Path, file: &str, cameras: &[Camera]) -> Value {
    let frames: Vec<Value> = cameras
        .iter()
        .enumerate()
        .map(|(i, camera)| {
            let name = format!("{}_{i}", file.trim_end_matches(".json"));
            write_image(&folder.join(format!("{name}.png")), &photograph(camera)).unwrap();
            json!({"file_path": format!("./{name}"), "transform_matrix": rows(camera.pose())})
        })
        .collect();
    let c = &cameras[0];
    let root = json!({
        "fl_x": c.focal.x, "fl_y": c.focal.y, "cx": c.principal.x, "cy": c.principal.y,
        "w": c.width, "h": c.height, "frames": frames,
    });
    write_json(&folder.join(file), &root);
    root
}

fn write_json(path: &Path, value: &Value) {
    std::fs::write(path, value.to_string()).unwrap();
}

/// World-to-camera rotation and translation, axes x right, y down, z forward.
pub(crate) fn world_to_camera(c: &Camera) -> (DMat3, DVec3) {
    let r = DMat3::from_cols(c.right, -c.up, c.forward).transpose();
    (r, -(r * c.eye))
}

/// All views in the order of the camera file: a set of so few has none held out.
pub(crate) fn in_order(dataset: &Dataset) -> Vec<&View> {
    assert!(dataset.test.is_empty(), "views that are held out");
    dataset.train.iter().collect()
}
