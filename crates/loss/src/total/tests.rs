//! The stochastic gradient of a fit against finite differences of its loss.

use std::path::PathBuf;

use crate::photometry::{Draw, Level, MaskUse, Target, photometric, pyramid};
use dataset::View;
use estimate::record::Pass;
use estimate::{Estimator, EstimatorOptions, Refined, Registry, SampleCounts};
use field::{Background, UniformBackground};
use film::Film;
use glam::{DVec2, DVec3, Vec3};
use inspect::Picture;
use multiview::stereo::{DepthMap, Guide};
use random::{Name, Stream};
use render::{Camera, Scene, render};
use sdf_nn::Encoding;

use crate::test_model::{BOUNDS, Model, background_model};
use crate::{
    Gradient, Objective, Regulariser, Stage, Surface, Targets, Wanted, Workspace, gradient,
};

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

/// A sharp surface with these samples in pixels that a silhouette may cross.
fn sharp(estimator: &dyn Estimator<f32>) -> Surface<'_> {
    let counts = SampleCounts { spp: 32, edge_samples: 8 };
    Surface::Sharp { estimator, counts, pass: Pass::Limited(1e6) }
}

const ORDER: Name = Name::other("order of pixels");
const DIRECTION: Name = Name::other("direction in the space of parameters");

const SOFT: Surface<'_> = Surface::Soft { sharpness: 20.0, depths: None };

/// The mean over seeds of the photometric gradient of a model.
fn mean_gradient(model: &Model, level: &Level, estimator: &dyn Estimator<f32>) -> Vec<f64> {
    // Three quarters of the pixels: the drawn number of pixels then differs from the expected one.
    let draws = level.draws_for(level.pixel_count() as u64, 4) * 3 / 4;
    let cameras = [camera()];
    let trained = model.field.parameters().len() + model.head.parameter_count();
    let mut mean = vec![0.0f64; trained];
    let seeds = 40;
    let share = level.pixel_count() as f64 / f64::from(SIZE * SIZE);
    let order = Stream::of_seed(1).named(ORDER);
    for seed in 0..seeds {
        let pixels: Vec<Draw> =
            (0..draws).map(|i| level.draw(i + seed * draws, 4, order)).collect();
        let scene = scene(model, &cameras);
        let objective = Objective {
            pixel_count: level.count_of(draws, 4) as f32,
            stream: Stream::of_seed(seed),
            ..Objective::photometric(scene, level, &pixels, sharp(estimator))
        };
        let sum = gradient(&objective, &mut Workspace::default()).unwrap().parameters;
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
        let stream = Stream::of_seed(direction).named(DIRECTION);
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

/// Rays that miss show the pixel of a picture behind the object: its own photograph has no loss
/// there, and another one has; nothing is left of it in the gradient by the solid.
#[test]
fn a_ray_that_misses_takes_the_pixel_of_the_picture() {
    let model = model(0.3, 24);
    let cameras = [camera()];
    let pixel = |i: u32| [0.1 + 0.05 * (i % 7) as f32, 0.5, 0.04 * (i % 11) as f32];
    let image = Film { width: SIZE, height: SIZE, pixels: (0..SIZE * SIZE).map(pixel).collect() };
    let picture = |image: &Film| {
        Picture::new(image.clone(), vec![true; image.pixels.len()], 0.01, Vec::new()).unwrap()
    };
    let level = level_of(image.clone(), true);
    // The corners of the film, which the ball does not reach.
    let draws: Vec<Draw> = [(1, 1), (2, 14), (14, 2)]
        .map(|(x, y)| Draw { view: 0, x, y, count: 1 })
        .into_iter()
        .collect();
    let found = |background: &Picture, surface| {
        let scene = Scene { background, ..scene(&model, &cameras) };
        let objective = Objective::photometric(scene, &level, &draws, surface);
        gradient(&objective, &mut Workspace::default()).unwrap()
    };
    for surface in [sharp(&Refined), Surface::Soft { sharpness: 200.0, depths: None }] {
        let own = found(&picture(&image), surface);
        assert!(own.stats.photometric < 1e-5, "{}", own.stats.photometric);
        let other =
            found(&picture(&Film { pixels: vec![[0.9; 3]; 256], ..image.clone() }), surface);
        assert!(other.stats.photometric > 0.3, "{}", other.stats.photometric);
    }
}

/// Two views of the target, and pixels of both.
struct TwoViews {
    model: Model,
    cameras: [Camera; 2],
    level: Level,
    pixels: Vec<Draw>,
}

impl TwoViews {
    fn new(count: u64) -> Self {
        let eye = DVec3::new(-2.0, 0.3, 2.2);
        let (focal, principal) = (DVec2::splat(26.0), DVec2::splat(8.0));
        let second =
            Camera::look_at(SIZE, SIZE, focal, principal, eye, DVec3::ZERO, DVec3::Y).unwrap();
        let cameras = [camera(), second];
        let image = target();
        let view = |camera: &Camera| View {
            name: String::new(),
            path: PathBuf::new(),
            camera: *camera,
            image: image.clone(),
            mask: None,
        };
        let views = cameras.each_ref().map(view);
        let level = pyramid(&views, MaskUse::None, &background_model(true), 1).remove(0);
        let order = Stream::of_seed(1).named(ORDER);
        let pixels = (0..count).map(|i| level.draw(i, 1, order)).collect();
        TwoViews { model: model(0.5, 24), cameras, level, pixels }
    }

    fn objective<'a>(&'a self, estimator: &'a dyn Estimator<f32>) -> Objective<'a> {
        let scene = scene(&self.model, &self.cameras);
        let regularisers = &[Regulariser::Eikonal(0.1), Regulariser::Bending(0.03)];
        let surface = sharp(estimator);
        let plain = Objective::photometric(scene, &self.level, &self.pixels, surface);
        Objective { regularisers, ..plain }
    }
}

/// The gradient on some threads.
fn on_threads(objective: &Objective<'_>, threads: usize, work: &mut Workspace) -> Gradient {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| gradient(objective, work)).unwrap()
}

/// Checks that a gradient has the same bits with other tasks on other threads, and in memory that
/// was used before.
fn check_bits(objective: &Objective<'_>, name: &str, work: &mut Workspace) -> Gradient {
    let first = on_threads(objective, 1, &mut Workspace::default());
    let bits = |gradient: &Gradient| -> Vec<u32> {
        gradient.parameters.iter().map(|g| g.to_bits()).collect()
    };
    for threads in [2, 3, 16] {
        let again = on_threads(objective, threads, work);
        let differ = bits(&first).iter().zip(&bits(&again)).position(|(a, b)| a != b);
        assert_eq!(differ, None, "{name}, {threads} threads");
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
    let mut views = TwoViews::new(400);
    // Some pixels of the ball contradict the others.
    for photograph in &mut views.level.photographs {
        photograph.image.pixels[8 * SIZE as usize + 7..][..2].fill([0.9; 3]);
    }
    let views = views;
    let gains = [Vec3::new(1.1, 0.9, 1.0), Vec3::splat(0.8)];
    let volume = views.model.background.jittered(Stream::of_seed(5).named(Name::other("points")));
    let distances = vec![0.0; (SIZE * SIZE) as usize];
    let maps = [0, 1].map(|_| DepthMap { width: SIZE as usize, distances: distances.clone() });
    // All cases use the same memory.
    let mut work = Workspace::default();
    for name in ["refined", "paper", "interior"] {
        let options = EstimatorOptions::default();
        let estimator = Registry::default().get(name).unwrap().estimator(&options);
        let plain = views.objective(&*estimator);
        let targets = Targets { gains: &gains, ..plain.targets };
        let plain = Objective { targets, ..plain };
        let found = check_bits(&plain, name, &mut work);
        assert!(found.parameters.iter().any(|g| *g != 0.0));
        let carving = Some(Guide { maps: &maps, scale: 1.0 });
        let carved = check_bits(&Objective { carving, ..plain }, name, &mut work);
        let bias = views.model.field.weight_count() - 1;
        // Carving raises f, against the gradient.
        let change = carved.parameters[bias] - found.parameters[bias];
        assert!(change < 0.0, "{name}: carving changes the slope by {change}");
        let background: &dyn Background<f32> = &volume;
        let scene = Scene { background, ..plain.scene };
        let wanted = Wanted { background: true, cameras: estimator.differentiates_cameras() };
        let trained = Objective { wanted, scene, ..plain };
        let found = check_bits(&trained, name, &mut work);
        let count = background.parameter_count();
        let of_background = &found.parameters[found.parameters.len() - count..];
        assert!(of_background.iter().any(|g| *g != 0.0), "{name}");
        let wanted = Wanted { cameras: false, ..wanted };
        let soft = Objective { surface: SOFT, wanted, ..trained };
        check_bits(&soft, name, &mut work);
    }
}

#[test]
fn batches_of_few_pixels_and_of_several_rounds_have_a_gradient() {
    for count in [0, 1, 15, 4100] {
        let views = TwoViews::new(count);
        let pixel_count = count.max(1) as f32;
        let objective = Objective { pixel_count, ..views.objective(&Refined) };
        let sharp = check_bits(&objective, "sharp", &mut Workspace::default());
        assert!(sharp.parameters.iter().all(|g| g.is_finite()));
        assert_eq!(sharp.stats.pixels, views.pixels.len() as u64);
        let soft = Objective { surface: SOFT, ..objective };
        check_bits(&soft, "soft", &mut Workspace::default());
    }
    // A solid that no ray hits.
    let mut views = TwoViews::new(100);
    let mut parameters = views.model.parameters();
    parameters[views.model.field.weight_count() - 1] += 5.0;
    views.model.set_parameters(&parameters);
    let missed = check_bits(&views.objective(&Refined), "missed", &mut Workspace::default());
    assert_eq!(missed.stats.edge_pixels, 0);
}

/// Parts that are dealt, joined and traced apart have the gradient of one record.
#[test]
fn cameras_and_gains_have_the_gradient_of_one_record() {
    let mut views = TwoViews::new(300);
    // One draw of each pixel: a record names pixels by their place.
    views.pixels.sort_by_key(|p| (p.view, p.y, p.x));
    views.pixels.dedup();
    let gains = [Vec3::new(1.3, 0.7, 1.0), Vec3::new(0.6, 1.0, 1.2)];
    let plain = views.objective(&Refined);
    let targets = Targets { gains: &gains, ..plain.targets };
    let wanted = Wanted { cameras: true, ..Wanted::default() };
    let objective = Objective { targets, wanted, regularisers: &[], ..plain };
    let found = gradient(&objective, &mut Workspace::default()).unwrap();
    // The gradient by the gain of a view is that of its own pixels alone.
    for view in 0..2 {
        let own: Vec<Draw> =
            views.pixels.iter().filter(|p| p.view == view as u32).copied().collect();
        let alone = Objective { draws: &own, ..objective };
        let alone = gradient(&alone, &mut Workspace::default()).unwrap();
        let [all, own] = [found.gains[view], alone.gains[view]];
        assert!((all - own).length() < 0.2 * own.length(), "{view}: {all} and {own}");
        assert_eq!(alone.gains[1 - view], DVec3::ZERO);
        assert_eq!(alone.cameras[1 - view], render::CameraAdjoint::default());
        let change = |adjoint: &render::CameraAdjoint| adjoint.eye;
        let [all, own] = [change(&found.cameras[view]), change(&alone.cameras[view])];
        assert!((all - own).length() < 0.3 * own.length(), "{view}: {all} and {own}");
    }
}

#[test]
fn an_observer_sees_each_task_begin_and_end() {
    let (cameras, model) = ([camera()], model(0.5, 24));
    let level = level_of(target(), false);
    let order = Stream::of_seed(1).named(ORDER);
    let pixels: Vec<Draw> = (0..250).map(|i| level.draw(i, 1, order)).collect();
    let scene = scene(&model, &cameras);
    let objective = Objective::photometric(scene, &level, &pixels, sharp(&Refined));
    let seen = std::sync::Arc::new(std::sync::Mutex::new(Vec::new()));
    let log = std::sync::Arc::clone(&seen);
    let observer = Box::new(move |stage, begins| log.lock().unwrap().push((stage, begins)));
    let observed = gradient(&objective, &mut Workspace::observed(16, observer)).unwrap();
    let plain = gradient(&objective, &mut Workspace::default()).unwrap();
    assert_eq!(observed.parameters, plain.parameters);
    let seen = seen.lock().unwrap();
    let count = |stage, begins| seen.iter().filter(|event| **event == (stage, begins)).count();
    for stage in [Stage::Trace, Stage::Record, Stage::Reverse, Stage::ReverseRecord] {
        assert_eq!((count(stage, true), count(stage, false)), (16, 16), "{stage:?}");
    }
    assert_eq!(count(Stage::Soft, true), 0);
    assert_eq!(count(Stage::Sum, true), count(Stage::Sum, false));
}
