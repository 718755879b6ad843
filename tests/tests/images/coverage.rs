//! The derivative of the coverage against the area of a ball's image in closed form.

use std::f64::consts::PI;
use std::path::Path;

use approx::assert_relative_eq;
use estimate::record::Adjoints;
use estimate::{Batch, EstimatorOptions, Registry, SampleCounts, SilhouetteMask, Terms};
use random::Stream;
use render::{Pixel, Scene};
use scene::SceneFile;
use serde_json::json;

/// Pixels along a side of the film.
const SIDE: u32 = 16;

/// The focal length in pixels, the distance of the ball's centre, and its radius.
const FOCAL: f64 = 36.0;
const DISTANCE: f64 = 4.0;
const RADIUS: f64 = 0.6;

/// The image of a ball on the camera's axis is a disc with the area π F² r²/(d² − r²), in pixels.
/// A second ball, before the first, covers nothing more.
#[test]
fn the_coverage_of_a_ball_is_the_area_of_its_disc() {
    let ball = json!({"type": "sphere", "center": [0, 0, 0], "radius": RADIUS});
    let before = json!({"type": "sphere", "center": [0.05, 0, 0.9], "radius": 0.15});
    let value = json!({
        "camera": {"width": SIDE, "height": SIDE, "focal": FOCAL, "principal": [8, 8],
                   "eye": [0, 0, DISTANCE], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "union", "children": [ball, before]},
        "appearance": {"type": "constant", "radiance": [0.3, 0.3, 0.3]},
        "background": [0.3, 0.3, 0.3]
    });
    let file = SceneFile::from_value(Path::new("scene.json"), &value).unwrap();
    let (field, background) = (file.field::<f64>().unwrap(), file.background::<f64>().unwrap());
    let (shader, cameras) = (file.shader::<f64>(&*field).unwrap(), [file.camera]);
    let scene = Scene::new(&*field, &*shader, &cameras, &file.bounds, &*background);
    let pixel = |i: u32| Pixel { camera: 0, x: i % SIDE, y: i / SIDE };
    let pixels: Vec<Pixel> = (0..SIDE * SIDE).map(pixel).collect();
    let batch = Batch {
        pixels: &pixels,
        counts: SampleCounts { spp: 64, edge_samples: 64 },
        stream: Stream::of_seed(1),
        terms: Terms::All,
    };
    let refined =
        Registry::default().get("refined").unwrap().estimator(&EstimatorOptions::default());
    let record = refined.record(&scene, &batch, &mut SilhouetteMask::default()).unwrap();

    let square = DISTANCE * DISTANCE - RADIUS * RADIUS;
    let area = PI * FOCAL * FOCAL * RADIUS * RADIUS / square;
    let found: f64 = record.coverage().iter().sum();
    println!("coverage {found}, area {area}");
    assert_relative_eq!(found, area, max_relative = 0.003);

    let mut out = Adjoints::default();
    record.coverage_vjp(&vec![1.0; pixels.len()], &mut out);
    let mut gradient = vec![0.0; field.parameter_count()];
    out.backward(&*field, &mut gradient);
    let of_radius = 2.0 * PI * FOCAL * FOCAL * RADIUS * DISTANCE * DISTANCE / (square * square);
    println!("gradient {gradient:?}, radius {of_radius}");
    // The parameters of a ball are the three of its centre, and its radius.
    assert_relative_eq!(gradient[3], of_radius, max_relative = 0.01);
    assert_relative_eq!(gradient[7], 0.0, epsilon = 1e-9 * of_radius);
}
