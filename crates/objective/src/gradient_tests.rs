//! The stochastic gradient of a fit against finite differences of its loss.

use std::path::PathBuf;

use background::Volume;
use dataset::View;
use estimate::record::Pass;
use estimate::{Estimator, EstimatorOptions, Refined, Registry, SampleCounts};
use film::Film;
use glam::{DVec2, DVec3, Vec3};
use photometry::{Level, MaskUse, Pixel, Target, photometric, pyramid};
use random::{Purpose, Stream};
use render::{Background, Camera, Scene, UniformBackground, render};
use sdf_nn::Encoding;

use crate::test_model::{BOUNDS, Model, background_model};
use crate::{Batch, Gradient, Stage, Workspace, gradient};

const BACKGROUND: UniformBackground<f32> = UniformBackground(Vec3::new(0.05, 0.1, 0.2));
const SIZE: u32 = 16;

fn camera() -> Camera {
    let (focal, principal) = (DVec2::splat(26.0), DVec2::splat(8.0));
    Camera::look_at(SIZE, SIZE, focal, principal, DVec3::new(0.5, 0.8, 3.0), DVec3::ZERO, DVec3::Y)
        .unwrap()
}

fn model(radius: f64, width: usize) -> Model {
    let mut model = Model::ball(radius, width, Encoding::None);
    let bias = model.last_bias();
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

/// The pyramid of one view of an image.
fn level_of(image: Film, is_trained: bool) -> Level {
    let view =
        View { name: String::new(), path: PathBuf::new(), camera: camera(), image, mask: None };
    pyramid(&[view], MaskUse::None, &background_model(is_trained), 1).remove(0)
}

fn batch<'a>(
    scene: Scene<'a, f32>,
    level: &'a Level,
    pixels: &'a [Pixel],
    estimator: &'a dyn Estimator<f32>,
) -> Batch<'a> {
    Batch {
        scene,
        level,
        pixels,
        pixel_count: pixels.len() as f32,
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
        seed: 0,
    }
}

/// The mean over seeds of the photometric gradient of a model.
fn mean_gradient(model: &Model, level: &Level, estimator: &dyn Estimator<f32>) -> Vec<f64> {
    // Three quarters of the pixels: the drawn number of pixels then differs from the expected one.
    let draws = level.draws_for(level.pixel_count() as u64, 4) * 3 / 4;
    let cameras = [camera()];
    let trained = model.field.parameters().len() + model.head.parameter_count();
    let mut mean = vec![0.0f64; trained];
    let seeds = 40;
    let share = level.pixel_count() as f64 / f64::from(SIZE * SIZE);
    let order = Stream::new(1, Purpose::PixelOrder);
    for seed in 0..seeds {
        let pixels: Vec<Pixel> =
            (0..draws).map(|i| level.draw(i + seed * draws, 4, order)).collect();
        let batch = Batch {
            pixel_count: level.count_of(draws, 4) as f32,
            seed,
            ..batch(scene(model, &cameras), level, &pixels, estimator)
        };
        let sum = gradient(&batch, &mut Workspace::default()).unwrap().parameters;
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
    let level = level_of(target.clone(), false);
    let mean = mean_gradient(&model, &level, estimator);
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

/// Checks that a gradient has the same bits with other tasks on other threads, and in memory that
/// was used before.
fn check_bits(batch: &Batch<'_>, name: &str) -> Gradient {
    let of = |workers: usize, work: &mut Workspace| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(workers).build().unwrap();
        pool.install(|| gradient(batch, work)).unwrap()
    };
    let mut work = Workspace::default();
    let first = of(1, &mut work);
    assert!(first.parameters.iter().any(|g| *g != 0.0));
    for workers in [2, 3, 16] {
        let again = of(workers, &mut work);
        let differ = first.parameters.iter().zip(&again.parameters).position(|(a, b)| a != b);
        assert_eq!(differ, None, "{name}, {workers} threads");
        assert_eq!(first.stats.photometric.to_bits(), again.stats.photometric.to_bits());
        assert_eq!(first.stats.rays, again.stats.rays, "{name}");
        assert_eq!(first.gains, again.gains, "{name}");
        assert_eq!(first.cameras, again.cameras, "{name}");
        work.reuse(again.parameters);
    }
    first
}

#[test]
fn the_bits_of_a_gradient_do_not_depend_on_threads_or_tasks() {
    let (cameras, model) = ([camera()], model(0.5, 24));
    let level = level_of(target(), true);
    let order = Stream::new(1, Purpose::PixelOrder);
    let pixels: Vec<Pixel> = (0..250).map(|i| level.draw(i, 1, order)).collect();
    let gains = [Vec3::new(1.1, 0.9, 1.0)];
    let scene = scene(&model, &cameras);
    let volume: &Volume<f32> = &model.background;
    for name in ["refined", "paper", "interior"] {
        let options = EstimatorOptions::default();
        let estimator = Registry::default().get(name).unwrap().estimator(&options);
        let plain = batch(scene, &level, &pixels, &*estimator);
        let plain = Batch { eikonal: 0.1, gains: &gains, ..plain };
        check_bits(&plain, name);
        let background: &dyn Background<f32> = volume;
        let scene = Scene { background, ..scene };
        let trained = Batch { trains_background: true, scene, ..plain };
        let trained = Batch { refines_cameras: estimator.differentiates_cameras(), ..trained };
        let found = check_bits(&trained, name);
        let background = &found.parameters[found.parameters.len() - volume.parameters().len()..];
        assert!(background.iter().any(|g| *g != 0.0), "{name}");
        check_bits(&Batch { sharpness: Some(20.0), refines_cameras: false, ..trained }, name);
    }
}

#[test]
fn an_observer_sees_each_task_begin_and_end() {
    let (cameras, model) = ([camera()], model(0.5, 24));
    let level = level_of(target(), false);
    let order = Stream::new(1, Purpose::PixelOrder);
    let pixels: Vec<Pixel> = (0..250).map(|i| level.draw(i, 1, order)).collect();
    let batch = batch(scene(&model, &cameras), &level, &pixels, &Refined);
    let seen = std::sync::Arc::new(std::sync::Mutex::new(Vec::new()));
    let log = std::sync::Arc::clone(&seen);
    let observer = Box::new(move |stage, begins| log.lock().unwrap().push((stage, begins)));
    let observed = gradient(&batch, &mut Workspace::observed(16, observer)).unwrap();
    let plain = gradient(&batch, &mut Workspace::default()).unwrap();
    assert_eq!(observed.parameters, plain.parameters);
    let seen = seen.lock().unwrap();
    let count = |stage, begins| seen.iter().filter(|event| **event == (stage, begins)).count();
    for stage in [Stage::Trace, Stage::Reverse] {
        assert_eq!((count(stage, true), count(stage, false)), (16, 16), "{stage:?}");
    }
    assert_eq!(count(Stage::Soft, true), 0);
    assert_eq!(count(Stage::Sum, true), count(Stage::Sum, false));
}
