//! The fit's stochastic gradient against differences of the loss that it descends.

use super::*;
use crate::pyramid::pyramid;
use crate::{FitOptions, Model};
use dataset::{Background, View};
use estimate::{Control, Method, render};
use field::Sphere;
use film::Film;
use render::Camera;
use std::path::PathBuf;

const BOUNDS: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 1.0 };
const SIZE: u32 = 16;

fn camera() -> Camera {
    let (focal, principal) = (DVec2::splat(26.0), DVec2::splat(8.0));
    Camera::look_at(SIZE, SIZE, focal, principal, DVec3::new(0.5, 0.8, 3.0), DVec3::ZERO, DVec3::Y)
        .unwrap()
}

fn model(radius: f64, width: usize) -> Model {
    let options = FitOptions {
        initial_radius: radius,
        width,
        layers: 2,
        bands: 0,
        beta: 20.0,
        ..FitOptions::default()
    };
    let mut model = Model::initial(&options, &BOUNDS);
    let bias = model.parameters().len() - 3;
    let mut parameters = model.parameters();
    parameters[bias] += 1.0;
    parameters[bias + 1] -= 0.5;
    model.set_parameters(&parameters);
    model
}

fn setup<'a>(model: &'a Model, cameras: &'a [Camera], steps: usize) -> Setup<'a, f32> {
    let setup = Setup::new(&model.field, &model.head, cameras, &BOUNDS, Vec3::new(0.05, 0.1, 0.2));
    let options = FitOptions::default();
    let warp = warp::Options { k: options.top_k, lambda_d: options.lambda_d as f32, ..setup.warp };
    let mut setup = setup;
    (setup.steps, setup.warp) = (steps, warp);
    setup
}

/// The mean photometric loss of the box-filtered image.
fn loss(model: &Model, target: &Film) -> f64 {
    let cameras = [camera()];
    let film = render(&setup(model, &cameras, 1), 0, 1024, 3, &|_| {}).unwrap().film;
    let pixels = (0..SIZE * SIZE).map(|i| (i % SIZE, i / SIZE));
    let each =
        pixels.map(|(x, y)| f64::from(photometric(film.at(x, y), &Target::of(target, x, y)).0));
    each.sum::<f64>() / film.pixels.len() as f64
}

/// The relative error of the mean gradient over four directions, with `steps` points along a ray.
fn error(method: Method, steps: usize) -> f64 {
    let cameras = [camera()];
    let target = render(&setup(&model(0.62, 24), &cameras, 1), 0, 64, 9, &|_| {}).unwrap().film;
    let target = Film {
        pixels: target.pixels.iter().map(|p| [p[0] * 0.6, p[1] * 1.2, p[2]]).collect(),
        ..target
    };
    let model = model(0.5, 24);
    let view = View {
        name: String::new(),
        path: PathBuf::new(),
        camera: camera(),
        image: target.clone(),
        mask: None,
    };
    let background = Background { color: [0.05, 0.1, 0.2], spread: 0.01, confidence: 1.0 };
    let backdrop = Backdrop { bounds: BOUNDS, background, use_masks: false };
    let levels = pyramid(&[view], &backdrop, 1);
    // A part of them, so that draws and what they stand for do not always go together.
    let draws = levels[0].draws_for(levels[0].pixel_count() as u64, 4) * 3 / 4;
    let mut mean = vec![0.0f64; model.parameters().len()];
    let seeds = 40;
    let share = levels[0].pixel_count() as f64 / f64::from(SIZE * SIZE);
    for seed in 0..seeds {
        let estimator = method.estimator(32, 8, Control::Mean).unwrap();
        let pixels: Vec<Pixel> =
            (0..draws).map(|i| levels[0].draw(i + seed * draws, 4, 1)).collect();
        let batch = Batch {
            setup: setup(&model, &cameras, steps),
            level: &levels[0],
            pixels: &pixels,
            pixel_count: levels[0].count_of(draws, 4) as f32,
            backdrop,
            weights: Weights { eikonal: 0.0, background: 0.0, trust: 0.0 },
            estimator: &*estimator,
            limit: 1e6,
            seed,
        };
        let (sum, _) = gradient(&batch).unwrap();
        mean.iter_mut()
            .zip(sum)
            .for_each(|(m, g)| *m += f64::from(g) * share / f64::from(seeds as u32));
    }
    let (mut error, mut square) = (0.0, 0.0);
    for direction in 0..4u64 {
        let step: Vec<f64> =
            (0..mean.len()).map(|i| unit(mix(direction, i as u64)) - 0.5).collect();
        // Only the field's parameters, along which silhouettes move.
        let fields = model.field.parameters().len();
        let along: f64 = mean.iter().zip(&step).take(fields).map(|(m, s)| m * s).sum();
        let moved = |h: f64| {
            let mut moved = model.clone();
            let shift = |i: usize| if i < fields { (h * step[i]) as f32 } else { 0.0 };
            let p: Vec<f32> =
                model.parameters().iter().enumerate().map(|(i, p)| p + shift(i)).collect();
            moved.set_parameters(&p);
            loss(&moved, &target)
        };
        let h = 4e-3;
        let difference = (moved(h) - moved(-h)) / (2.0 * h);
        println!("{method:?}, {steps} points, direction {direction}: {along} against {difference}");
        error += (along - difference).powi(2);
        square += difference * difference;
    }
    (error / square).sqrt()
}

/// What is left, measured 0.09, is the bias of 22 points (0.07 with 200), large here because the
/// object is eight pixels across, and the loss of one sample where a pixel without silhouettes has
/// a mean.
#[test]
fn the_mean_gradient_is_that_of_the_loss() {
    let steps = FitOptions::default().steps;
    let relative = error(Method::Refined, steps);
    println!("refined: {relative}");
    assert!(relative < 0.13, "relative error {relative} over the directions");
}
