//! The gradient through a soft surface against differences of a loss that is written out here.

use std::path::PathBuf;

use dataset::View;
use field::{Background, BackgroundRay, Field, Shader};
use film::Film;
use glam::{DVec2, DVec3, Vec3};
use multiview::stereo::{DepthMap, Guide};
use random::{Name, Stream};
use render::{Camera, Scene};

use super::*;
use crate::drawn::{PART, PARTS};
use crate::photometry::{Level, MaskUse, Target, photometric, pyramid};
use crate::test_model::{BOUNDS, Model, background_model};
use crate::{Objective, Surface, Wanted, Workspace, gradient};
use sdf_nn::Encoding;

const SIZE: u32 = 12;
const SHARPNESS: f32 = 12.0;

/// Seeds whose mean gradient is compared with differences: each has points and chances of its own.
const SEEDS: u64 = 8;

/// A ball of this radius, in bounding radii.
fn model(radius: f64) -> Model {
    Model::ball(radius, 16, Encoding::Frequency { bands: 2 })
}

fn camera() -> Camera {
    let (focal, principal) = (DVec2::splat(20.0), DVec2::splat(6.0));
    Camera::look_at(SIZE, SIZE, focal, principal, DVec3::new(0.5, 0.8, 3.0), DVec3::ZERO, DVec3::Y)
        .unwrap()
}

/// A picture without a pattern that the model could have.
fn level() -> Level {
    let value = |i: u32| [0.1 + 0.07 * (i % 7) as f32, 0.5, 0.08 * (i % 11) as f32];
    let image = Film { width: SIZE, height: SIZE, pixels: (0..SIZE * SIZE).map(value).collect() };
    let view =
        View { name: String::new(), path: PathBuf::new(), camera: camera(), image, mask: None };
    pyramid(&[view], MaskUse::None, &background_model(true), 1).remove(0)
}

fn scene<'a>(model: &'a Model, cameras: &'a [Camera]) -> Scene<'a, f32> {
    Scene::new(&model.field, &model.head, cameras, &BOUNDS, &model.background)
}

/// Φ of the opacity.
fn phi(f: f32) -> f64 {
    1.0 / (1.0 + (-f64::from(SHARPNESS) * f64::from(f)).exp())
}

/// The mean loss of rays whose points are at the given distances.
fn loss(model: &Model, rays: &Traced<'_>, pixels: &[Draw], level: &Level) -> f64 {
    let mut total = 0.0;
    for (sample, pixel) in pixels.iter().enumerate() {
        let ray: BackgroundRay<f32> = rays.background[sample];
        let mut seen = [Vec3::ZERO];
        model.background.radiance(&[ray], &mut seen);
        let (mut sum, mut pass) = (DVec3::ZERO, 1.0);
        if let Some(i) = rays.of_chord.iter().position(|of| *of == sample) {
            let (origin, direction): (Vec3, Vec3) = (ray.origin, ray.direction);
            let t = &rays.points.t[i * POINTS..(i + 1) * POINTS];
            let x: Vec<Vec3> = t.iter().map(|t| origin + direction * *t).collect();
            let mut f = vec![0.0; POINTS];
            model.field.value(&x, &mut f);
            for k in 0..INTERVALS {
                if rays.weights[i * INTERVALS + k] == 0.0 {
                    continue;
                }
                // A chord begins outside the solid.
                let before = if k == 0 { 1.0 } else { phi(f[k]) };
                let opacity = (1.0 - phi(f[k + 1]) / before).max(0.0);
                let middle = [(x[k] + x[k + 1]) * 0.5];
                let (mut value, mut gradient, mut rgb) = ([0.0], [Vec3::ZERO], [Vec3::ZERO]);
                model.field.value_gradient(&middle, &mut value, &mut gradient);
                let (normal, view) = ([gradient[0].normalize()], [direction]);
                let point = SurfaceBatch { x: &middle, normal: &normal, direction: &view };
                model.head.radiance(&point, &mut rgb);
                sum += rgb[0].as_dvec3() * (pass * opacity);
                pass *= 1.0 - opacity;
            }
        }
        sum += seen[0].as_dvec3() * pass;
        let photograph = &level.photographs[0];
        let seen = |x, y| photograph.over(Vec3::ZERO, x, y);
        let target = Target::of(photograph.size(), seen, pixel.x.into(), pixel.y.into());
        total += f64::from(photometric(sum.as_vec3().to_array(), &target).0);
    }
    total / pixels.len() as f64
}

#[test]
fn the_gradient_of_a_soft_surface_matches_differences() {
    check_gradient(0.5);
}

#[test]
fn the_gradient_of_a_soft_surface_that_reaches_the_sphere_matches_differences() {
    check_gradient(1.0);
}

fn objective<'a>(
    scene: Scene<'a, f32>,
    level: &'a Level,
    draws: &'a [Draw],
    surface: Surface<'a>,
) -> Objective<'a> {
    let wanted = Wanted { background: true, cameras: false };
    Objective {
        wanted,
        stream: Stream::of_seed(4),
        ..Objective::photometric(scene, level, draws, surface)
    }
}

fn all_pixels() -> Vec<Draw> {
    let row = |y| (0..SIZE as u16).map(move |x| Draw { view: 0, x, y, count: 1 });
    (0..SIZE as u16).flat_map(row).collect()
}

#[test]
fn known_depths_and_contradictions_move_the_surface() {
    let (model, cameras, pixels) = (model(0.5), [camera()], all_pixels());
    // Two pixels of the ball are not as grey as its first radiance.
    let level_of = |value: f32| {
        let mut level = level();
        let photograph = &mut level.photographs[0].image.pixels;
        photograph.fill([0.25; 3]);
        photograph[5 * SIZE as usize + 5..][..2].fill([value; 3]);
        level
    };
    let (bright, overexposed) = (level_of(0.9), level_of(1.0));
    // The last bias of the network raises f everywhere.
    let bias = model.field.weight_count() - 1;
    let slope_of = |level: &Level, distance: f32, carves: bool| {
        let maps = [DepthMap { width: SIZE as usize, distances: vec![distance; 144] }];
        let depths = Some(Guide { maps: &maps, scale: 1.0 });
        let surface = Surface::Soft { sharpness: 80.0, depths };
        let plain = objective(scene(&model, &cameras), level, &pixels, surface);
        let carving = depths.filter(|_| carves);
        gradient(&Objective { carving, ..plain }, &mut Workspace::default()).unwrap().parameters
            [bias]
    };
    let slope = |distance: f32, carves: bool| slope_of(&bright, distance, carves);
    // A surface behind or before that of the ball, and no known depth.
    let (behind, before, unknown) = (slope(5.0, false), slope(2.3, false), slope(0.0, false));
    assert!(behind < unknown && before > unknown, "{behind}, {before}, {unknown}");
    // Some pixels at the ball's border contradict too.
    let carved = |level: &Level| slope_of(level, 0.0, false) - slope_of(level, 0.0, true);
    let (bright, overexposed) = (carved(&bright), carved(&overexposed));
    assert!(bright > 0.0 && overexposed < 0.8 * bright, "{bright}, {overexposed}");
}

fn check_gradient(initial_radius: f64) {
    let (mut model, level, cameras) = (model(initial_radius), level(), [camera()]);
    // The colours of the initial head are nearly the same everywhere.
    let mut parameters = model.parameters();
    let head = model.field.parameters().len()..;
    parameters[head].iter_mut().for_each(|p| *p *= 3.0);
    model.set_parameters(&parameters);
    let pixels = all_pixels();
    let surface = Surface::Soft { sharpness: SHARPNESS, depths: None };
    let plain = objective(scene(&model, &cameras), &level, &pixels, surface);
    let gradient_of = |stream: Stream| {
        gradient(&Objective { stream, ..plain }, &mut Workspace::default()).unwrap().parameters
    };
    // The parts have points of their own. These are found again here.
    let rounds = |seed: u64| Objective { stream: Stream::of_seed(seed).named(PART).at(0), ..plain };
    let rounds: Vec<Objective<'_>> = (0..SEEDS).map(rounds).collect();
    let parts: Vec<Traced<'_>> = rounds
        .iter()
        .flat_map(Drawn::parts)
        .map(|drawn| Traced::new(drawn, SHARPNESS).unwrap())
        .collect();
    let all: Vec<Vec<f32>> = (0..SEEDS).map(|seed| gradient_of(Stream::of_seed(seed))).collect();
    // Small adjoints are passed on by chance: with signs of its own, a gradient would seem too large.
    let signs = gradient_of(Stream::of_seed(SEEDS));
    let share = 1.0 / (SEEDS as usize * PARTS) as f64;
    let total = |model: &Model| {
        parts.iter().map(|rays| share * loss(model, rays, rays.drawn.draws, &level)).sum::<f64>()
    };
    let start = model.parameters();
    assert_eq!(start.len(), signs.len());
    let field = model.field.parameters().len();
    let shape = field + model.head.parameter_count();
    for (name, range) in
        [("field", 0..field), ("head", field..shape), ("background", shape..start.len())]
    {
        let stream = Stream::of_seed(7).named(Name::other("steps of parameters"));
        // Every parameter moves so that the loss should grow.
        let step = |i: usize| stream.at(i as u64).unit() as f32 * signs[i].signum();
        let of_seed =
            |own: &Vec<f32>| -> f64 { range.clone().map(|i| f64::from(own[i] * step(i))).sum() };
        let along = all.iter().map(of_seed).sum::<f64>() / SEEDS as f64;
        let moved = |h: f32| {
            let mut parameters = start.clone();
            range.clone().for_each(|i| parameters[i] += h * step(i));
            let mut moved = model.clone();
            moved.set_parameters(&parameters);
            total(&moved)
        };
        let h = 2e-4;
        let difference = (moved(h) - moved(-h)) / (2.0 * f64::from(h));
        println!("{name}: {along} against {difference}");
        assert!((along / difference - 1.0).abs() < 0.015, "{name}: {along}, {difference}");
    }
}

#[test]
fn a_number_by_chance_has_its_mean_and_no_small_size() {
    let stream = Stream::of_seed(3).named(Name::other("chances"));
    for value in [-0.5, -0.01, 0.0, 0.02, 0.049, 0.05, 0.7] {
        let numbers = (0..40_000).map(|i| by_chance(value, 0.05, stream.at(i)));
        let numbers: Vec<f32> = numbers.collect();
        assert!(numbers.iter().all(|n| *n == 0.0 || n.abs() >= 0.05));
        let mean = numbers.iter().map(|n| f64::from(*n)).sum::<f64>() / 40_000.0;
        // Five standard errors of the largest.
        assert!((mean - f64::from(value)).abs() < 5.0 * 0.025 / 200.0, "{value}: {mean}");
    }
}
