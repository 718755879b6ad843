//! Depth maps of walls whose distances have closed forms.

#![allow(clippy::print_stdout, reason = "the measured errors")]
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use field::Sphere;
use film::Film;
use glam::{DVec2, DVec3};
use multiview::stereo::{DepthMap, Stereo, View};
use random::Stream;
use render::Camera;

const SIDE: u32 = 64;

/// Rays of a pixel along each side.
const PARTS: u32 = 4;

/// The ball whose rays are searched.
const BALL: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 1.0 };

/// A plane n·x = offset with a pattern.
#[derive(Clone, Copy)]
struct Wall {
    normal: DVec3,
    offset: f64,
}

impl Wall {
    /// The distance of the wall along a ray.
    fn distance(&self, origin: DVec3, direction: DVec3) -> f64 {
        (self.offset - self.normal.dot(origin)) / self.normal.dot(direction)
    }
}

/// A pattern without a period that patches could confuse.
fn pattern(x: DVec3) -> f32 {
    let wave = |a: DVec3, phase: f64| (a.dot(x) + phase).sin();
    let warped = wave(DVec3::new(9.0, 4.0, 3.0), 1.5 * wave(DVec3::new(2.0, 5.0, 1.0), 0.3));
    (0.4 + 0.2 * warped + 0.15 * wave(DVec3::new(-5.0, 13.0, 6.0), 1.0)) as f32
}

fn cameras() -> Vec<Camera> {
    let camera = |i: u32| {
        let angle = f64::from(i) * 0.15 - 0.4;
        let eye = DVec3::new(4.0 * angle.sin(), 0.3 * f64::from(i % 2), 4.0 * angle.cos());
        let (focal, middle) = (DVec2::splat(90.0), DVec2::splat(f64::from(SIDE) / 2.0));
        Camera::look_at(SIDE, SIDE, focal, middle, eye, DVec3::ZERO, DVec3::Y).unwrap()
    };
    (0..6).map(camera).collect()
}

fn ray(camera: &Camera, i: usize) -> DVec3 {
    let side = SIDE as usize;
    camera.direction(DVec2::new((i % side) as f64 + 0.5, (i / side) as f64 + 0.5))
}

/// The depth maps of photographs whose pixels have the values `seen`, by the number of the camera,
/// its eye and the direction of the ray.
fn maps_of(seen: &dyn Fn(usize, DVec3, DVec3) -> f32) -> Vec<DepthMap> {
    let cameras = cameras();
    let photograph = |(number, camera): (usize, &Camera)| {
        let mut image = Film::new(SIDE, SIDE);
        for (i, pixel) in image.pixels.iter_mut().enumerate() {
            let (x, y) = ((i % SIDE as usize) as f64, (i / SIDE as usize) as f64);
            let part = |k: u32| {
                let (a, b) = (f64::from(k % PARTS), f64::from(k / PARTS));
                let u = DVec2::new(x, y) + (DVec2::new(a, b) + 0.5) / f64::from(PARTS);
                seen(number, camera.eye, camera.direction(u))
            };
            *pixel = [(0..PARTS * PARTS).map(part).sum::<f32>() / (PARTS * PARTS) as f32; 3];
        }
        image
    };
    let images: Vec<Film> = cameras.iter().enumerate().map(photograph).collect();
    let views: Vec<View<'_>> =
        cameras.iter().zip(&images).map(|(camera, image)| View { camera, image }).collect();
    Stereo::new(&views, &BALL, Stream::of_seed(3)).depth_maps()
}

/// The depth maps of walls whose points have the given values.
fn maps(walls: &[Wall], value: &dyn Fn(DVec3) -> f32, exposure: bool) -> Vec<DepthMap> {
    maps_of(&|number, eye, direction| {
        let gain = if exposure { 0.7 + 0.1 * number as f32 } else { 1.0 };
        gain * value(eye + direction * nearest(walls, eye, direction))
    })
}

fn nearest(walls: &[Wall], origin: DVec3, direction: DVec3) -> f64 {
    let distances = walls.iter().map(|wall| wall.distance(origin, direction));
    distances.filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min)
}

/// The share of pixels with a known distance, and the share of these that are off by more than 1 %.
/// 0.41 of the pixels are searched.
fn known_and_wrong(maps: &[DepthMap], walls: &[Wall]) -> (f64, f64) {
    let (mut known, mut wrong, mut all) = (0.0, 0.0, 0.0);
    for (camera, map) in cameras().iter().zip(maps) {
        for (i, found) in map.distances.iter().enumerate() {
            all += 1.0;
            if *found > 0.0 {
                known += 1.0;
                let t = nearest(walls, camera.eye, ray(camera, i));
                wrong += f64::from(u8::from((f64::from(*found) / t - 1.0).abs() > 0.01));
            }
        }
    }
    (known / all, wrong / f64::max(known, 1.0))
}

const SLANTED: Wall = Wall { normal: DVec3::new(0.48, 0.0, 0.8772684879784525), offset: 0.1 };

#[test]
fn a_slanted_wall_has_its_distances() {
    let (known, wrong) = known_and_wrong(&maps(&[SLANTED], &pattern, false), &[SLANTED]);
    println!("known {known}, wrong {wrong}");
    assert!(known > 0.33 && wrong < 0.01, "{known}, {wrong}");
}

#[test]
fn exposures_do_not_matter() {
    let (known, wrong) = known_and_wrong(&maps(&[SLANTED], &pattern, true), &[SLANTED]);
    println!("known {known}, wrong {wrong}");
    assert!(known > 0.33 && wrong < 0.01, "{known}, {wrong}");
}

#[test]
fn a_wall_behind_the_ball_is_found() {
    let wall = Wall { normal: DVec3::Z, offset: -3.0 };
    let slow = |x: DVec3| pattern(x * 0.6);
    let (known, wrong) = known_and_wrong(&maps(&[wall], &slow, false), &[wall]);
    println!("known {known}, wrong {wrong}");
    assert!(known > 0.3 && wrong < 0.1, "{known}, {wrong}");
}

#[test]
fn nothing_is_known_of_a_surface_without_a_pattern() {
    let maps = maps(&[SLANTED], &|_| 0.5, false);
    assert!(maps.iter().all(|map| map.known() == 0.0));
}

#[test]
fn stripes_and_outlines_are_left_out() {
    let stripes = maps(&[SLANTED], &|x| (0.5 + 0.3 * (9.0 * x.x).sin()) as f32, false);
    // A white ball in front of black: its outline is another curve in each photograph.
    let ball = Sphere { radius: 0.95, ..BALL };
    let outline = maps_of(&|_, eye, direction| match ball.clip(eye, direction) {
        Some((near, far)) => (10.0 * (far - near)).min(0.9) as f32,
        None => 0.0,
    });
    for maps in [stripes, outline] {
        let known = maps.iter().map(DepthMap::known).fold(0.0, f64::max);
        println!("known {known}");
        assert!(known < 0.005, "{known}");
    }
}

#[test]
fn distances_do_not_depend_on_the_number_of_threads() {
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| maps(&[SLANTED], &pattern, false))
    };
    assert_eq!(of(1), of(3));
}
