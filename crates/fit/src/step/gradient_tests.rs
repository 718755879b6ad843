//! The stochastic gradient of a fit against finite differences of its loss.

use super::*;
use crate::model::Model;
use crate::options::FitOptions;
use crate::run_file::RunFile;
use dataset::{BackgroundEstimate, View};
use estimate::record::Pass;
use estimate::{Estimator, Refined, SampleCounts};
use field::Sphere;
use film::Film;
use glam::{DVec2, DVec3, Vec3};
use photometry::{BackgroundModel, Level, MaskUse, Target, photometric, pyramid};
use render::{Camera, Scene, UniformBackground, render};
use std::path::PathBuf;

const BOUNDS: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 1.0 };
const BACKGROUND: UniformBackground<f32> = UniformBackground(Vec3::new(0.05, 0.1, 0.2));
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
    let background = BACKGROUND.0.to_array();
    let mut model = Model::initial(&RunFile { background, ..RunFile::of_test(options) });
    let bias = model.parameters().len() - 3;
    let mut parameters = model.parameters();
    parameters[bias] += 1.0;
    parameters[bias + 1] -= 0.5;
    model.set_parameters(&parameters);
    model
}

fn scene<'a>(model: &'a Model, cameras: &'a [Camera]) -> Scene<'a, f32> {
    Scene::new(&model.field, &model.head, cameras, &BOUNDS, &BACKGROUND)
}

/// The target of a pixel of an image.
fn target_at(image: &Film, x: u32, y: u32) -> Target {
    Target::of([image.width, image.height], |x, y| image.at(x, y), x, y)
}

/// The mean photometric loss of the box-filtered image.
fn loss(model: &Model, target: &Film) -> f64 {
    let cameras = [camera()];
    let film = render(&scene(model, &cameras), 0, 1024, 3, &|_| {}).unwrap().film;
    let pixels = (0..SIZE * SIZE).map(|i| (i % SIZE, i / SIZE));
    let each =
        pixels.map(|(x, y)| f64::from(photometric(film.at(x, y), &target_at(target, x, y)).0));
    each.sum::<f64>() / film.pixels.len() as f64
}

/// The image of another sphere in other colours.
fn target() -> Film {
    let cameras = [camera()];
    let film = render(&scene(&model(0.62, 24), &cameras), 0, 64, 9, &|_| {}).unwrap().film;
    let pixels = film.pixels.iter().map(|p| [p[0] * 0.6, p[1] * 1.2, p[2]]).collect();
    Film { pixels, ..film }
}

fn background_model() -> BackgroundModel {
    let estimate = BackgroundEstimate { color: [0.05, 0.1, 0.2], spread: 0.01, confidence: 1.0 };
    BackgroundModel { bounds: BOUNDS, estimates: vec![estimate], is_trained: false }
}

/// The mean over seeds of the photometric gradient of a model.
fn mean_gradient(model: &Model, level: &Level, estimator: &dyn Estimator<f32>) -> Vec<f64> {
    // Three quarters of the pixels: the drawn number of pixels then differs from the expected one.
    let draws = level.draws_for(level.pixel_count() as u64, 4) * 3 / 4;
    let cameras = [camera()];
    let mut mean = vec![0.0f64; model.parameters().len()];
    let seeds = 40;
    let share = level.pixel_count() as f64 / f64::from(SIZE * SIZE);
    let order = Stream::new(1, Purpose::PixelOrder);
    for seed in 0..seeds {
        let pixels: Vec<Pixel> =
            (0..draws).map(|i| level.draw(i + seed * draws, 4, order)).collect();
        let batch = Batch {
            scene: scene(model, &cameras),
            level,
            pixels: &pixels,
            pixel_count: level.count_of(draws, 4) as f32,
            trains_background: false,
            refines_cameras: false,
            behind: &[],
            gains: &[],
            eikonal: 0.0,
            estimator,
            counts: SampleCounts { spp: 32, edge_samples: 8 },
            pass: Pass::Limited(1e6),
            sharpness: None,
            depths: None,
            carves: false,
            seed,
        };
        let sum = gradient(&batch).unwrap().parameters;
        mean.iter_mut()
            .zip(sum)
            .for_each(|(m, g)| *m += f64::from(g) * share / f64::from(seeds as u32));
    }
    mean
}

/// The relative L2 error of the mean gradient over four directions in the space of the field's
/// parameters, along which silhouettes move.
fn error(estimator: &dyn Estimator<f32>) -> f64 {
    let (target, model) = (target(), model(0.5, 24));
    let view = View {
        name: String::new(),
        path: PathBuf::new(),
        camera: camera(),
        image: target.clone(),
        mask: None,
    };
    let levels = pyramid(&[view], MaskUse::None, &background_model(), 1);
    let mean = mean_gradient(&model, &levels[0], estimator);
    let fields = model.field.parameters().len();
    let (mut error, mut square) = (0.0, 0.0);
    for direction in 0..4u64 {
        let stream = Stream::new(direction, Purpose::WeightDirection);
        let step: Vec<f64> = (0..mean.len()).map(|i| stream.at(i as u64).unit() - 0.5).collect();
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
        println!("direction {direction}: {along} against {difference}");
        error += (along - difference).powi(2);
        square += difference * difference;
    }
    (error / square).sqrt()
}

/// The measured error is 0.09. It comes from the pixels without silhouettes: their loss is that of
/// one sample instead of the pixel's mean, and the object is only eight pixels across.
#[test]
fn the_mean_gradient_matches_differences_of_the_loss() {
    let relative = error(&Refined);
    println!("refined: {relative}");
    assert!(relative < 0.13, "relative error {relative} over the directions");
}
