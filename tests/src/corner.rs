//! Photographs of the corner of a room with patterned walls, whose poses are known. They need no
//! file, and a program that searches photographs for the same points finds many.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use glam::{DVec2, DVec3};
use image::{Rgb, RgbImage};
use random::{Name, Stream};
use render::Camera;

/// The size of a photograph, and its focal length, in pixels.
const SIZE: (u32, u32) = (480, 360);
const FOCAL: f64 = 420.0;

/// The room is a cube around the origin: the distance of a wall from it.
const WALL: f64 = 2.0;

/// The sizes of the pattern's cells in three layers, in the units of [`WALL`].
const CELLS: [f64; 3] = [0.35, 0.12, 0.05];

const COLORS: Name = Name::new("colours of cells", 1 << 32 | 0xc010);

/// Cameras on an arc in front of one corner, about 6° apart as seen from it.
///
/// # Panics
/// Never.
pub fn cameras(count: u32) -> Vec<Camera> {
    let corner = DVec3::splat(-WALL);
    let camera = |i: u32| {
        let turn = 0.1 * (f64::from(i) - f64::from(count - 1) / 2.0);
        let side = DVec3::new(turn.sin(), 0.15 * f64::from(i % 3), -turn.sin());
        let eye = corner + 1.7 * DVec3::ONE + 1.7 * side;
        let (width, height) = SIZE;
        let principal = DVec2::new(f64::from(width), f64::from(height)) / 2.0;
        let target = corner + DVec3::splat(0.3);
        Camera::look_at(width, height, DVec2::splat(FOCAL), principal, eye, target, DVec3::Y)
    };
    (0..count).map(|i| camera(i).unwrap()).collect()
}

/// The photograph of a camera in the room, with four rays a pixel.
pub fn photograph(camera: &Camera) -> RgbImage {
    let offsets = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
    RgbImage::from_fn(camera.width, camera.height, |x, y| {
        let colors = offsets.map(|(u, v)| {
            let direction = camera.direction(DVec2::new(f64::from(x) + u, f64::from(y) + v));
            // The ray leaves the room through the nearest of three walls.
            let distances = (direction.signum() * WALL - camera.eye) / direction;
            pattern(camera.eye + distances.min_element() * direction)
        });
        Rgb((colors.iter().sum::<DVec3>() / 4.0).to_array().map(|v| (255.0 * v) as u8))
    })
}

/// The colour of a point: layers of cells with random colours, with smooth borders.
fn pattern(x: DVec3) -> DVec3 {
    let layers = CELLS.iter().zip(0..).map(|(size, layer)| {
        let stream = Stream::of_seed(layer).named(COLORS);
        let (low, part) = ((x / size).floor(), (x / size).fract_gl());
        let smooth = part * part * (3.0 - 2.0 * part);
        let corners = (0..8).map(|i| {
            let offset = DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
            let weight = offset * smooth + (1.0 - offset) * (1.0 - smooth);
            let cell = (low + offset).to_array().into_iter();
            let stream = cell.fold(stream, |stream, c| stream.at(c as i64 as u64));
            weight.element_product() * DVec3::from([0, 1, 2].map(|c| stream.at(c).unit()))
        });
        corners.sum::<DVec3>()
    });
    layers.sum::<DVec3>() / CELLS.len() as f64
}
