//! Depth maps of walls whose distances have closed forms.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use field::Sphere;
use film::Film;
use glam::{DVec2, DVec3};
use render::Camera;
use stereo::{DepthMap, Stereo, View};

const SIDE: u32 = 64;

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

/// The depth maps of walls whose pixels have the given values.
fn maps(walls: &[Wall], value: &dyn Fn(DVec3) -> f32, exposure: bool) -> Vec<DepthMap> {
    let cameras = cameras();
    let photograph = |(number, camera): (usize, &Camera)| {
        let mut image = Film::new(SIDE, SIDE);
        let gain = if exposure { 0.7 + 0.1 * number as f32 } else { 1.0 };
        for (i, pixel) in image.pixels.iter_mut().enumerate() {
            let direction = ray(camera, i);
            let t = nearest(walls, camera.eye, direction);
            *pixel = [gain * value(camera.eye + direction * t); 3];
        }
        image
    };
    let images: Vec<Film> = cameras.iter().enumerate().map(photograph).collect();
    let views: Vec<View<'_>> =
        cameras.iter().zip(&images).map(|(camera, image)| View { camera, image }).collect();
    Stereo::new(&views, &Sphere { center: DVec3::ZERO, radius: 1.0 }, 3).depth_maps()
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
    assert!(known > 0.35 && wrong < 0.02, "{known}, {wrong}");
}

#[test]
fn exposures_do_not_matter() {
    let (known, wrong) = known_and_wrong(&maps(&[SLANTED], &pattern, true), &[SLANTED]);
    println!("known {known}, wrong {wrong}");
    assert!(known > 0.35 && wrong < 0.02, "{known}, {wrong}");
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
fn distances_do_not_depend_on_the_number_of_threads() {
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| maps(&[SLANTED], &pattern, false))
    };
    assert_eq!(of(1), of(3));
}
