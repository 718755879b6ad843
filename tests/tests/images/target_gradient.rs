//! The gradient of an image loss against differences of the loss.

use estimate::gradient::{Direction, Sampling, differentiate, target_gradient};
use estimate::record::{Adjoints, Pass};
use estimate::{
    Baseline, Batch, Estimator, EstimatorOptions, Registry, SampleCounts, SilhouetteMask, Terms,
};
use field::PartialSum;
use film::Film;
use glam::DVec3;
use random::Stream;
use render::Pixel;
use render::{Scene, render};
use scene::{BackgroundModel, SceneFile};
use serde_json::json;
use std::path::Path;

/// A Lambertian ball on a film of 12 × 10 pixels.
fn file(radius: f64, x: f64) -> SceneFile {
    let value = json!({
        "camera": {"width": 12, "height": 10, "focal": 20.0, "principal": [6, 5],
                   "eye": [0.4, -0.3, 3.6], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "sphere", "center": [x, 0.03, 0], "radius": radius},
        "appearance": {
            "type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.2, 0.2, 0.2],
            "lights": [{
                "type": "directional", "direction": [0.3, 0.5, 0.8], "radiance": [1, 1, 1]
            }]
        },
        "background": [0.1, 0.2, 0.3]
    });
    SceneFile::from_value(Path::new("scene.json"), &value).unwrap()
}

fn with_scene<T>(file: &SceneFile, run: impl FnOnce(&Scene<'_, f64>) -> T) -> T {
    let field = file.field::<f64>().unwrap();
    let shader = file.shader::<f64>(&*field).unwrap();
    let cameras = [file.camera];
    let background = file.background().unwrap();
    run(&Scene::new(&*field, &*shader, &cameras, &file.bounds, &*background))
}

/// Reverse mode against Σ (I − target) dI/dθ in forward mode, which is checked against closed forms
/// elsewhere.
#[test]
fn reverse_mode_agrees_with_forward_mode() {
    let target =
        with_scene(&file(0.78, 0.1), |scene| render(scene, 0, 64, 5, &|_| {}).unwrap().film);
    with_scene(&file(0.7, 0.05), |scene| {
        let registry = Registry::default();
        for entry in registry.entries() {
            check_transpose(scene, entry.name);
        }
        let image = render(scene, 0, 1024, 6, &|_| {}).unwrap().film;
        // The tolerances contain the noise: with `paper`, motion along the view has a tenth.
        for (name, tolerance) in [("paper", 0.15), ("refined", 0.02), ("band", 0.05)] {
            check_agreement(scene, &image, &target, name, tolerance);
        }
    });
}

fn estimator(name: &str, baseline: Baseline) -> Box<dyn Estimator<f64>> {
    let options = EstimatorOptions { baseline, ..EstimatorOptions::default() };
    Registry::default().get(name).unwrap().estimator(&options)
}

/// A ball that has the radiance of its background is not visible. Without a baseline, the warp
/// carries that radiance, and the derivative is noise around 0.
#[test]
fn without_a_baseline_the_background_is_carried_too() {
    let derivative = |radiance: f64, baseline| {
        let mut file = file(0.7, 0.05);
        file.appearance.parameters = [vec![1.0; 3], vec![radiance; 3], vec![0.0; 6]].concat();
        file.appearance.parameters[6] = 1.0;
        file.background =
            BackgroundModel::Constant { radiance: [radiance; 3], pointer: "/background" };
        with_scene(&file, |scene| {
            let sampling = Sampling { counts: SampleCounts { spp: 16, edge_samples: 8 }, seed: 1 };
            let estimator = estimator("paper", baseline);
            let wrt = [Direction::Field(3)];
            let images = differentiate(scene, &wrt, &*estimator, sampling, &|_| {}).unwrap();
            images[0].film.pixels.iter().map(|p| p[0].abs()).sum::<f32>()
        })
    };
    assert_eq!(derivative(0.0, Baseline::None), 0.0, "a black background");
    assert_eq!(derivative(0.5, Baseline::Background), 0.0);
    assert!(derivative(0.5, Baseline::None) > 1.0);
}

/// `Σ δ_p ∂I_p/∂θ` of the same record: pixel by pixel, and in one sum.
fn check_transpose(scene: &Scene<'_, f64>, name: &str) {
    let pixels: Vec<Pixel> = (0..120).map(|i| Pixel { camera: 0, x: i % 12, y: i / 12 }).collect();
    let delta: Vec<DVec3> =
        (0..120).map(|i| DVec3::new(0.3, -0.7, 0.2) * f64::from(i % 7) + 0.1).collect();
    let counts = SampleCounts { spp: 9, edge_samples: 4 };
    let batch = Batch { pixels: &pixels, counts, stream: Stream::of_seed(3), terms: Terms::All };
    for baseline in [Baseline::Background, Baseline::PixelMean, Baseline::None] {
        let mut mask = SilhouetteMask::default();
        let record = estimator(name, baseline).record(scene, &batch, &mut mask).unwrap();
        let gradient = |delta: &[DVec3], pass| {
            let mut adjoints = Adjoints::default();
            let mut shader = PartialSum::zero(scene.shader.parameter_count(), 0..0);
            record.vjp(scene, delta, pass, &mut shader, &mut adjoints);
            let mut sum = vec![0.0; scene.field.parameter_count()];
            adjoints.backward(scene.field, &mut sum);
            sum
        };
        let together = gradient(&delta, Pass::Sum);
        let mut apart = vec![0.0; together.len()];
        for p in 0..pixels.len() {
            let mut one = vec![DVec3::ZERO; pixels.len()];
            one[p] = delta[p];
            apart.iter_mut().zip(gradient(&one, Pass::PerPixel)).for_each(|(sum, g)| *sum += g);
        }
        let scale = together.iter().map(|g| g.abs()).fold(0.0, f64::max);
        assert!(scale > 0.1, "{name}: {together:?}");
        for (a, b) in together.iter().zip(&apart) {
            assert!((a - b).abs() < 1e-9 * scale, "{name}: {together:?} against {apart:?}");
        }
    }
}

/// The target gradient against Σ (I − target) dI/dθ over derivative images, for some parameters.
fn check_agreement(
    scene: &Scene<'_, f64>,
    image: &Film,
    target: &Film,
    name: &str,
    tolerance: f64,
) {
    let estimator = estimator(name, Baseline::Background);
    let counts = SampleCounts { spp: 256, edge_samples: 256 };
    let sampling = Sampling { counts, seed: 1 };
    let reverse = target_gradient(scene, target, &*estimator, sampling, &|_| {}).unwrap();
    let directions: Vec<Direction> = [0, 2, 3, 4, 9, 10, 11, 12]
        .into_iter()
        .filter(|j| *j < reverse.parameters.len())
        .map(Direction::Field)
        .collect();
    let forward = differentiate(scene, &directions, &*estimator, sampling, &|_| {}).unwrap();
    for (direction, derivative) in directions.iter().zip(&forward) {
        let Direction::Field(j) = *direction else { continue };
        let (mut sum, mut scale) = (0.0, 0.0);
        for p in 0..target.pixels.len() {
            for c in 0..3 {
                let term = f64::from(image.pixels[p][c] - target.pixels[p][c])
                    * f64::from(derivative.film.pixels[p][c]);
                sum += term;
                scale += term.abs();
            }
        }
        let got = reverse.parameters[j];
        assert!(
            (got - sum).abs() < tolerance * scale,
            "{name}, parameter {j}: reverse {got}, forward {sum}, of {scale}"
        );
    }
}
