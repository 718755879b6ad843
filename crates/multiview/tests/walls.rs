//! Depth maps of walls whose distances have closed forms.

#![allow(clippy::print_stdout, reason = "the measured errors")]
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use field::Sphere;
use film::Film;
use glam::{DVec2, DVec3};
use multiview::stereo::{Consistency, DepthMap, PointConsistency, Stereo, View};
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

/// Photographs whose pixels have the values `seen`, by the number of the camera, its eye and the
/// direction of the ray.
fn photographs(cameras: &[Camera], seen: &dyn Fn(usize, DVec3, DVec3) -> f32) -> Vec<Film> {
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
    cameras.iter().enumerate().map(photograph).collect()
}

/// The depth maps of these photographs.
fn maps_of(seen: &dyn Fn(usize, DVec3, DVec3) -> f32) -> Vec<DepthMap> {
    let cameras = cameras();
    let images = photographs(&cameras, seen);
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

/// The consistency of photographs of a wall with this gain of each at points of another plane: the
/// losses of a grid of pixels of the third photograph, and the middles of these pixels.
struct OnWall {
    consistency: Consistency,
    camera: Camera,
}

impl OnWall {
    fn new(wall: Wall) -> Self {
        let cameras = cameras();
        let images = photographs(&cameras, &|number, eye, direction| {
            let x = eye + direction * wall.distance(eye, direction);
            (0.7 + 0.1 * number as f32) * pattern(x)
        });
        let views: Vec<View<'_>> =
            cameras.iter().zip(&images).map(|(camera, image)| View { camera, image }).collect();
        OnWall { consistency: Consistency::new(&views, &BALL), camera: cameras[2] }
    }

    /// The consistency at the point of `plane` that a pixel shows.
    fn at(&self, pixel: [u32; 2], plane: Wall) -> Option<(PointConsistency, DVec3)> {
        let ray = self.camera.direction(DVec2::from(pixel.map(f64::from)) + 0.5);
        let x = self.camera.eye + ray * plane.distance(self.camera.eye, ray);
        let found = self.consistency.at(2, pixel, x.as_vec3(), plane.normal.as_vec3())?;
        Some((found, x))
    }
}

fn pixels() -> impl Iterator<Item = [u32; 2]> {
    (8..SIDE - 8).step_by(5).flat_map(|y| (8..SIDE - 8).step_by(5).map(move |x| [x, y]))
}

#[test]
fn photographs_are_most_consistent_on_the_wall_that_they_show() {
    let normal = DVec3::new(0.1, 0.2, 1.0).normalize();
    let wall = Wall { normal, offset: 0.1 };
    let on_wall = OnWall::new(wall);
    let moved = |by: f64| Wall { offset: wall.offset + by, ..wall };
    let turned = |by: DVec3, x: DVec3| {
        let normal = (normal + by).normalize();
        Wall { normal, offset: normal.dot(x) }
    };
    let mut right = 0;
    let mut found = 0;
    for pixel in pixels() {
        let Some((here, x)) = on_wall.at(pixel, wall) else { continue };
        assert!(here.loss < 0.02, "{pixel:?}: {}", here.loss);
        let loss = |plane| on_wall.at(pixel, plane).map_or(1.0, |(own, _)| own.loss);
        let others = [moved(0.08), moved(-0.08), turned(DVec3::X, x), turned(DVec3::Y * 0.9, x)];
        found += 1;
        right += usize::from(others.into_iter().all(|other| loss(other) > here.loss));
    }
    println!("{right} of {found} pixels are most consistent on the wall");
    assert!(found > 60 && right * 100 > found * 97, "{right} of {found}");
}

#[test]
fn the_adjoints_of_consistency_match_differences() {
    let normal = DVec3::new(-0.2, 0.1, 1.0).normalize();
    let on_wall = OnWall::new(Wall { normal, offset: 0.1 });
    // Off the wall, so that the derivatives are not small.
    let plane = Wall { normal: (normal + DVec3::new(0.1, -0.1, 0.0)).normalize(), offset: 0.14 };
    let loss = |pixel, x: DVec3, normal: DVec3| {
        let own = on_wall.consistency.at(2, pixel, x.as_vec3(), normal.as_vec3())?;
        Some(f64::from(own.loss))
    };
    let (mut errors, mut sizes) = (Vec::new(), Vec::new());
    for pixel in pixels() {
        let Some((here, x)) = on_wall.at(pixel, plane) else { continue };
        let h = 3e-3;
        for (by_point, bar) in [(true, here.x), (false, here.normal)] {
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let at = |h: f64| match by_point {
                    true => loss(pixel, x + axis * h, plane.normal),
                    false => loss(pixel, x, plane.normal + axis * h),
                };
                let (Some(after), Some(before)) = (at(h), at(-h)) else { continue };
                let difference = (after - before) / (2.0 * h);
                errors.push((difference - f64::from(bar.dot(axis.as_vec3()))).abs());
                sizes.push(difference.abs());
            }
        }
        // The length of the normal does not count.
        let along = here.normal.dot(plane.normal.as_vec3());
        assert!(along.abs() < 1e-3 * here.normal.length() + 1e-5, "{along}");
    }
    // Interpolated photographs have kinks in the middles of pixels, which some differences cross.
    errors.sort_by(f64::total_cmp);
    let mean = sizes.iter().sum::<f64>() / sizes.len() as f64;
    let at = |part: f64| errors[(part * errors.len() as f64) as usize] / mean;
    println!("errors over the mean derivative: {:.4} in the middle, 80 % {:.4}", at(0.5), at(0.8));
    assert!(errors.len() > 400 && at(0.5) < 0.015 && at(0.8) < 0.04);
}
