//! Scenes far from the world's origin: images and derivative images in single precision, against
//! those of the same scene near the origin.

use std::path::Path;

use estimate::gradient::{Direction, Sampling, differentiate};
use estimate::{EstimatorOptions, Registry, SampleCounts};
use field::SLOPE_POINTS;
use random::Stream;
use render::{Scene, render};
use scene::SceneFile;
use sdf_nn::{Activation, Architecture, Encoding, Network, Transform};
use serde_json::{Value, json};

const SAMPLES: u32 = 64;

/// A place of the world.
const PLACE: [f64; 3] = [1e6, -2e6, 3e6];

/// A scene about the point `c`. The positions in it are relative to `c`.
fn scene(c: [f64; 3], sdf: &Value, light: [f64; 3]) -> Value {
    let at = |p: [f64; 3]| json!([c[0] + p[0], c[1] + p[1], c[2] + p[2]]);
    json!({
        "camera": {"width": 12, "height": 12, "focal": 20, "principal": [6, 6],
                   "eye": at([0.25, 0.5, 4.0]), "target": at([0.0; 3]), "up": [0, 1, 0]},
        "sdf": sdf,
        "appearance": {
            "type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.15, 0.1, 0.2],
            "lights": [{"type": "point", "position": at(light), "intensity": [9, 8, 7]}]
        },
        "background": [0.05, 0.1, 0.2]
    })
}

/// A lens, a floor that reaches far, and a network, about the point `c`.
fn solids(c: [f64; 3], weights: &str) -> [Value; 3] {
    let at = |p: [f64; 3]| json!([c[0] + p[0], c[1] + p[1], c[2] + p[2]]);
    let ball = |x: f64| json!({"type": "sphere", "center": at([x, 0.0, 0.0]), "radius": 0.75});
    let floor = json!({"type": "plane", "normal": [0, 1, 0], "offset": c[1] - 0.5});
    [
        json!({"type": "intersection", "children": [ball(0.25), ball(-0.25)]}),
        json!({"type": "union", "children": [floor, ball(0.0)]}),
        json!({"type": "neural", "weights": weights}),
    ]
}

/// The image and the derivative image by the parameter `index`, in single precision.
fn images(folder: &Path, scene: &Value, index: usize) -> [Vec<[f32; 3]>; 2] {
    let file = SceneFile::from_value(&folder.join("scene.json"), scene).unwrap();
    let field = file.field::<f32>().unwrap();
    let shader = file.shader::<f32>(&*field).unwrap();
    let cameras = [file.camera];
    let background = file.background::<f32>().unwrap();
    let scene = Scene::new(&*field, &*shader, &cameras, &file.bounds, &*background)
        .with_slope_of_field(SLOPE_POINTS);
    let image = render(&scene, 0, SAMPLES, 0, &|_| {}).unwrap().film.pixels;
    let registry = Registry::default();
    let refined = registry.get("refined").unwrap().estimator(&EstimatorOptions::default());
    let counts = SampleCounts { spp: SAMPLES, edge_samples: SAMPLES / 2 };
    let sampling = Sampling { counts, seed: 0 };
    let direction = [Direction::Field(index)];
    let mut derivatives = differentiate(&scene, &direction, &*refined, sampling, &|_| {}).unwrap();
    [image, derivatives.remove(0).film.pixels]
}

/// The relative L2 distance of two images.
fn distance(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let norm = |numbers: &mut dyn Iterator<Item = f32>| {
        numbers.map(|v| f64::from(v) * f64::from(v)).sum::<f64>().sqrt()
    };
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    norm(&mut pairs.map(|(a, b)| a - b)) / norm(&mut b.iter().flatten().copied())
}

#[test]
fn a_distant_scene_has_the_image_and_the_derivatives_of_a_near_one() {
    let folder = tempfile::tempdir().unwrap();
    let architecture = Architecture {
        encoding: Encoding::Frequency { bands: 2 },
        grid: sdf_nn::SplineSize::none(),
        hidden: vec![16; 2],
        skip: vec![],
        activation: Activation::Softplus { beta: 20.0 },
    };
    for (name, center) in [("near", [0.0; 3]), ("far", PLACE)] {
        let transform = Transform { center: center.into(), radius: 1.0 };
        let network =
            Network::<f32>::geometric(architecture.clone(), transform, 0.6, Stream::of_seed(3));
        let file = folder.path().join(format!("{name}.safetensors"));
        std::fs::write(file, network.to_safetensors().unwrap()).unwrap();
    }
    // A radius of the lens, the height of the floor, and a weight.
    let parameters = [("lens", 3), ("floor", 3), ("network", 0)];
    let light = [2.0, 3.0, 3.0];
    let near = solids([0.0; 3], "near.safetensors").map(|sdf| scene([0.0; 3], &sdf, light));
    let far = solids(PLACE, "far.safetensors").map(|sdf| scene(PLACE, &sdf, light));
    for ((near, far), (name, index)) in near.iter().zip(&far).zip(parameters) {
        let [near, far] = [near, far].map(|scene| images(folder.path(), scene, index));
        let [image, derivative] = [0, 1].map(|i| distance(&far[i], &near[i]));
        assert!(image < 1e-3 && derivative < 1e-2, "{name}: {image}, {derivative}");
    }
}
