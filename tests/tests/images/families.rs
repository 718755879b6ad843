//! Derivative images over generated families of solids, against closed forms and dense samples.
//!
//! Every family has fixed seeds. The bias of `refined` is at most 1 % and three standard errors,
//! that of `contour` 2 %.

use std::path::Path;

use crate::truth::{Camera, Look, Solid, dense, truth};
use estimate::gradient::{Direction, Sampling, differentiate, random_unit};
use estimate::{EstimatorOptions, Registry, SampleCounts};
use field::{Field, SLOPE_POINTS};
use random::{Name, Stream};
use render::{Scene, render};
use scene::SceneFile;
use sdf_nn::{Activation, Architecture, Encoding, Network, Transform};
use serde_json::{Value, json};

const FAMILIES: Name = Name::new("scenes of a family", 1 << 32 | 13);

/// Random numbers of a family.
struct Random(Stream);

impl Random {
    fn new(seed: u64) -> Self {
        Random(Stream::of_seed(seed).named(FAMILIES))
    }

    /// A number in [from, to).
    fn between(&mut self, from: f64, to: f64) -> f64 {
        self.0 = self.0.at(1);
        from + (to - from) * self.0.unit()
    }

    /// A vector with components in [−reach, reach).
    fn vector(&mut self, reach: f64) -> [f64; 3] {
        std::array::from_fn(|_| self.between(-reach, reach))
    }
}

/// A scene with a Lambertian solid, seen from a random place on a film of `side` × `side` pixels.
fn lit(random: &mut Random, sdf: &Value, side: u32) -> Value {
    let eye = [random.between(-1.5, 1.5), random.between(-0.5, 1.5), random.between(3.0, 4.0)];
    let light = [random.between(-1.0, 1.0), random.between(-1.0, 1.0), 1.0];
    json!({
        "camera": {"width": side, "height": side, "focal": 1.8 * f64::from(side),
                   "principal": [f64::from(side) / 2.0, f64::from(side) / 2.0],
                   "eye": eye, "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": sdf,
        "appearance": {
            "type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.15, 0.1, 0.2],
            "lights": [{"type": "directional", "direction": light, "radiance": [0.9, 0.8, 0.7]}]
        },
        "background": [0.05, 0.1, 0.2]
    })
}

/// A white solid in front of black. The smooth part of its derivatives is zero.
fn white(random: &mut Random) -> Value {
    let mut scene = lit(random, &json!(null), 5);
    scene["appearance"] = json!({"type": "constant", "radiance": [1, 1, 1]});
    scene["background"] = json!([0, 0, 0]);
    scene
}

/// An estimator with its samples per pixel.
type Method = (&'static str, u32);

/// Scenes of a family.
const SCENES: u64 = 3;

/// Samples per pixel of most runs.
const SPP: u32 = 128;

/// Runs whose mean is compared with the truth, each with its own seed.
const SEEDS: u64 = 4;

/// The pixels of an image, linear RGB.
type Pixels = Vec<[f32; 3]>;

/// The derivative images of an estimator by each direction: one a seed, or one alone if it does not
/// depend on seeds.
fn images(
    file: &SceneFile,
    (estimator, spp): Method,
    directions: &[Direction],
) -> Vec<Vec<Pixels>> {
    let field = file.field::<f64>().unwrap();
    let shader = file.shader::<f64>(&*field).unwrap();
    let cameras = [file.camera];
    let background = file.background().unwrap();
    let scene = Scene::new(&*field, &*shader, &cameras, &file.bounds, &*background);
    let scene = scene.with_slope_of_field(SLOPE_POINTS);
    let registry = Registry::default();
    let estimator = registry.get(estimator).unwrap().estimator(&EstimatorOptions::default());
    let mut runs = vec![Vec::new(); directions.len()];
    for seed in 0..if estimator.depends_on_seed() { SEEDS } else { 1 } {
        let counts = SampleCounts { spp, edge_samples: spp / 2 };
        let sampling = Sampling { counts, seed };
        let images = differentiate(&scene, directions, &*estimator, sampling, &|_| {}).unwrap();
        runs.iter_mut().zip(images).for_each(|(runs, image)| runs.push(image.film.pixels));
    }
    runs
}

/// The squared L2 norm of the numbers of an image.
fn square(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.map(|v| v * v).sum()
}

/// The relative L2 bias of the mean of images, and its standard error.
fn bias(runs: &[Pixels], truth: &[[f64; 3]]) -> (f64, f64) {
    let n = runs.len() as f64;
    let places = || (0..truth.len()).flat_map(|p| (0..3).map(move |c| (p, c)));
    let mean = |(p, c): (usize, usize)| runs.iter().map(|r| f64::from(r[p][c])).sum::<f64>() / n;
    let scale = square(truth.iter().flatten().copied()).sqrt();
    let off = square(places().map(|at| mean(at) - truth[at.0][at.1])).sqrt();
    let spread: f64 = runs
        .iter()
        .map(|run| square(places().map(|at| f64::from(run[at.0][at.1]) - mean(at))))
        .sum();
    (off / scale, (spread / (n * (n - 1.0).max(1.0))).sqrt() / scale)
}

/// A check of one derivative image: prints its row, and returns a line if it is out of tolerance.
fn check(name: &str, estimator: &str, runs: &[Pixels], truth: &[[f64; 3]]) -> Option<String> {
    let (bias, error) = bias(runs, truth);
    let row = format!("{name}, {estimator}: bias {bias:.4} ± {error:.4}");
    println!("{row}");
    // `contour` guesses the ends of curves inside its cells.
    let allowed = if estimator == "contour" { 0.02 } else { 0.01 + 3.0 * error };
    (bias.is_nan() || bias > allowed).then_some(row)
}

/// Checks estimators on a scene, by each of the parameters.
fn check_solid(name: &str, value: &Value, wrt: &[&str], methods: &[Method]) -> Vec<String> {
    let file = SceneFile::from_value(Path::new("family.json"), value).unwrap();
    let (camera, look) = (Camera::of(value), Look::of(value));
    // An unbounded solid ends at a ball around the eye.
    let reach = file.clip.map_or(f64::INFINITY, |ball| ball.radius);
    let has_corners = value["sdf"].to_string().contains("\"box\"");
    let tolerance = if has_corners { 1e-3 } else { f64::INFINITY };
    let truths = wrt.iter().map(|wrt| {
        let truth = truth(&camera, 1e-5, tolerance, |offset| {
            let mut value = value.clone();
            let number = value.pointer_mut(wrt).unwrap();
            *number = json!(number.as_f64().unwrap() + offset);
            let (solid, eye, look) = (Solid::of(&value["sdf"]), camera.eye, &look);
            move |d| solid.see(look, reach, eye, d)
        });
        truth.derivative
    });
    let truths: Vec<_> = truths.collect();
    let pointers = file.sdf.pointers();
    let index = |wrt: &&str| pointers.iter().position(|p| p.as_deref() == Some(*wrt)).unwrap();
    let directions: Vec<_> = wrt.iter().map(|wrt| Direction::Field(index(wrt))).collect();
    let mut failures = Vec::new();
    for method in methods {
        let runs = images(&file, *method, &directions);
        for ((wrt, runs), truth) in wrt.iter().zip(&runs).zip(&truths) {
            failures.extend(check(&format!("{name} {wrt}"), method.0, runs, truth));
        }
    }
    failures
}

fn assert_none(failures: &[String]) {
    assert!(failures.is_empty(), "too large:\n{}", failures.join("\n"));
}

/// Checks the scenes of a family. `make` makes the solid of a scene from random numbers.
fn check_family(name: &str, wrt: &[&str], make: impl Fn(&mut Random) -> Value) {
    let failures: Vec<String> = (1..=SCENES)
        .flat_map(|seed| {
            let mut random = Random::new(seed);
            let sdf = make(&mut random);
            let scene = lit(&mut random, &sdf, 9);
            // `contour` takes most of the time.
            let methods = [("refined", SPP), ("contour", 1024)];
            let methods = if seed == 1 { &methods[..] } else { &methods[..1] };
            check_solid(&format!("{name} {seed}"), &scene, wrt, methods)
        })
        .collect();
    assert_none(&failures);
}

fn sphere(center: [f64; 3], radius: f64) -> Value {
    json!({"type": "sphere", "center": center, "radius": radius})
}

fn cuboid(random: &mut Random, reach: f64, least: f64, most: f64) -> Value {
    let half_size = [0, 1, 2].map(|_| random.between(least, most));
    json!({"type": "box", "center": random.vector(reach), "half_size": half_size})
}

#[test]
fn boxes() {
    let wrt = ["/sdf/center/0", "/sdf/half_size/1"];
    check_family("box", &wrt, |random| cuboid(random, 0.2, 0.3, 0.7));
}

/// One of a ball, a box and a capsule, at random.
fn primitive(random: &mut Random) -> Value {
    match random.between(0.0, 3.0) as u32 {
        0 => sphere(random.vector(0.5), random.between(0.25, 0.6)),
        1 => cuboid(random, 0.4, 0.2, 0.5),
        _ => {
            let (a, b) = (random.vector(0.7), random.vector(0.7));
            json!({"type": "capsule", "a": a, "b": b, "radius": random.between(0.1, 0.3)})
        }
    }
}

/// A tree of primitives with up to `depth` levels of operations.
fn tree(random: &mut Random, depth: u32) -> Value {
    if depth == 0 {
        return primitive(random);
    }
    let operation =
        ["union", "union", "subtraction", "intersection"][random.between(0.0, 4.0) as usize];
    let second = if random.between(0.0, 1.0) < 0.5 { depth - 1 } else { 0 };
    let children = [tree(random, depth - 1), tree(random, second)];
    json!({"type": operation, "children": children})
}

#[test]
fn trees() {
    check_family("tree", &["/sdf/children/0/children/0/radius"], |random| {
        let ball = sphere(random.vector(0.2), random.between(0.5, 0.7));
        let depth = random.between(1.0, 3.0) as u32;
        let joined = json!({"type": "union", "children": [ball, tree(random, depth)]});
        json!({"type": "subtraction", "children": [joined, primitive(random)]})
    });
}

#[test]
fn lenses() {
    let wrt = ["/sdf/children/0/radius", "/sdf/children/1/center/2"];
    check_family("lens", &wrt, |random| {
        let near = sphere([0.3, random.between(-0.2, 0.2), 0.3], random.between(0.6, 0.8));
        let far = sphere([-0.3, 0.0, random.between(-0.3, 0.1)], random.between(0.6, 0.8));
        let balls = [near, far];
        json!({"type": "intersection", "children": balls})
    });
}

#[test]
fn shells() {
    let wrt = ["/sdf/children/0/radius", "/sdf/children/2/radius"];
    check_family("shell", &wrt, |random| {
        let radius = random.between(0.6, 0.8);
        let inner = radius - random.between(0.02, 0.2);
        let cut = [random.between(-0.3, 0.3), random.between(-0.3, 0.3), 0.8];
        json!({"type": "subtraction", "children": [
            sphere([0.0; 3], radius), sphere([0.0; 3], inner),
            sphere(cut, random.between(0.35, 0.55))
        ]})
    });
}

#[test]
fn cut_balls() {
    let wrt = ["/sdf/children/0/radius", "/sdf/children/1/offset", "/sdf/children/1/normal/0"];
    check_family("cut ball", &wrt, |random| {
        let normal = [random.between(-1.0, 1.0), random.between(-1.0, 1.0), 0.7];
        json!({"type": "intersection", "children": [
            sphere(random.vector(0.2), random.between(0.6, 0.9)),
            {"type": "plane", "normal": normal, "offset": random.between(-0.2, 0.4)}
        ]})
    });
}

#[test]
fn capsule_pairs() {
    let wrt = ["/sdf/children/0/a/0", "/sdf/children/1/radius"];
    check_family("capsules", &wrt, |random| {
        let capsules = [0, 1].map(|_| {
            let (a, b) = (random.vector(0.7), random.vector(0.7));
            json!({"type": "capsule", "a": a, "b": b, "radius": random.between(0.15, 0.35)})
        });
        json!({"type": "union", "children": capsules})
    });
}

#[test]
fn floors() {
    let mut random = Random::new(0);
    let (tilt, height) = (random.between(-0.1, 0.1), random.between(-1.2, -0.8));
    let sdf = json!({"type": "union", "children": [
        {"type": "plane", "normal": [tilt, 1.0, 0.05], "offset": height},
        sphere(random.vector(0.4), random.between(0.4, 0.8))
    ]});
    // The horizon crosses the film.
    let mut scene = lit(&mut random, &sdf, 5);
    scene["camera"]["eye"] = json!([0.3, random.between(0.0, 0.4), 4.0]);
    let wrt = ["/sdf/children/0/normal/2", "/sdf/children/1/radius"];
    assert_none(&check_solid("floor", &scene, &wrt, &[("refined", SPP)]));
}

/// A network whose solid is a bumpy ball of about `radius`, in the unit ball.
///
/// f is `factor` times the network's own.
fn bumpy(random: &mut Random, radius: f64, bump: f64, factor: f64) -> Network<f64> {
    let architecture = Architecture {
        encoding: Encoding::Frequency { bands: 2 },
        grid: sdf_nn::SplineSize::none(),
        hidden: vec![16, 16],
        skip: vec![],
        activation: Activation::Softplus { beta: 5.0 },
    };
    let ball = Network::geometric(architecture, Transform::default(), radius, Stream::of_seed(7));
    loop {
        let mut parameters = ball.parameters().to_vec();
        parameters.iter_mut().for_each(|p| *p += random.between(-bump, bump));
        // The last layer has 16 weights and a bias.
        let last = parameters.len() - 17;
        parameters[last..].iter_mut().for_each(|p| *p *= factor);
        let mut network = ball.clone();
        network.set_parameters(&parameters);
        // Some sets of weights have no solid.
        let mut f = [0.0];
        network.value(&[glam::DVec3::ZERO], &mut f);
        if f[0] < 0.0 {
            return network;
        }
    }
}

/// The sum of all numbers of an image, in pixels for a white solid in front of black.
fn total(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.sum::<f64>() / 3.0
}

/// Checks the area of a white network in an image of 256 samples a pixel.
fn check_area(name: &str, file: &SceneFile, truth: &[[f64; 3]]) -> Option<String> {
    let field = file.field::<f64>().unwrap();
    let shader = file.shader::<f64>(&*field).unwrap();
    let cameras = [file.camera];
    let background = file.background().unwrap();
    let scene = Scene::new(&*field, &*shader, &cameras, &file.bounds, &*background);
    let film = render(&scene.with_slope_of_field(SLOPE_POINTS), 0, 256, 1, &|_| {}).unwrap().film;
    let area = total(film.pixels.iter().flatten().copied().map(f64::from));
    let expected = total(truth.iter().flatten().copied());
    let row = format!("{name}: area {area:.4}, expected {expected:.4}");
    println!("{row}");
    ((area / expected - 1.0).abs() > 0.005).then_some(row)
}

/// Checks the area of a white network, and `refined` along a random direction of its weights.
fn check_network(name: &str, scene: &mut Value, network: &Network<f64>, spp: u32) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("n.safetensors"), network.to_safetensors().unwrap()).unwrap();
    scene["sdf"] = json!({"type": "neural", "weights": "n.safetensors"});
    let file = SceneFile::from_value(&folder.path().join("scene.json"), scene).unwrap();
    // The weights as the file has them, in single precision.
    let bytes = std::fs::read(folder.path().join("n.safetensors")).unwrap();
    let network = Network::<f64>::from_safetensors(&bytes).unwrap();
    let tangent = random_unit::<f64>(Field::<f64>::parameter_count(&network), 3);
    let (camera, look) = (Camera::of(scene), Look::of(scene));
    let truth = truth(&camera, 1e-3, f64::INFINITY, |offset| {
        let mut moved = network.clone();
        let parameters: Vec<f64> =
            network.parameters().iter().zip(&tangent).map(|(p, t)| p + offset * t).collect();
        moved.set_parameters(&parameters);
        let (eye, look) = (camera.eye, &look);
        move |d| dense::see(look, &moved, eye, d)
    });
    let runs = images(&file, ("refined", spp), &[Direction::Along(3)]);
    let derivative = check(name, "refined", &runs[0], &truth.derivative);
    check_area(name, &file, &truth.image).into_iter().chain(derivative).collect()
}

#[test]
fn networks_of_all_slopes() {
    let mut failures = Vec::new();
    for (seed, factor) in [0.2, 4.0, 10.0].into_iter().enumerate() {
        let mut random = Random::new(seed as u64);
        let network = bumpy(&mut random, 0.6, 0.15, factor);
        let mut scene = white(&mut random);
        failures.extend(check_network(&format!("network × {factor}"), &mut scene, &network, SPP));
    }
    assert_none(&failures);
}

#[test]
fn lit_networks() {
    let mut random = Random::new(23);
    let network = bumpy(&mut random, 0.6, 0.15, 10.0);
    let mut scene = lit(&mut random, &json!(null), 5);
    assert_none(&check_network("lit network × 10", &mut scene, &network, 256));
}

#[test]
fn networks_that_reach_their_ball() {
    let mut failures = Vec::new();
    for seed in 0..2 {
        let mut random = Random::new(seed);
        let network = bumpy(&mut random, 0.95, 0.15, 1.0);
        let mut scene = white(&mut random);
        failures.extend(check_network(&format!("cut network {seed}"), &mut scene, &network, SPP));
    }
    assert_none(&failures);
}
