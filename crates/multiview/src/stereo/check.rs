//! Agreement of depths between photographs.

use crate::stereo::photo::Photo;
use crate::stereo::search::{Found, middle};

/// The largest cost of a plane that counts: a correlation of 0.7.
pub(crate) const LARGEST_COST: f32 = 0.3;

/// The photographs that must agree with a depth.
const AGREEING: usize = 2;

/// The largest distance, in pixels, of a point from the pixel where it began, on the way through
/// another photograph's plane and back.
const PIXELS: f32 = 1.0;

/// The largest difference of the depths on this way, as a part of the depth.
const DEPTH: f32 = 0.02;

/// The distance along the unit ray of each pixel of photograph `own`, row-major, where the planes
/// of two other photographs agree with it; else 0.
pub(crate) fn agreed(
    photos: &[Photo],
    found: &[Vec<Option<Found>>],
    own: usize,
    others: &[usize],
) -> Vec<f32> {
    let photo = &photos[own];
    let distance = |i: usize| {
        let found_here = found[own][i].filter(|found| found.cost < LARGEST_COST)?;
        let own_middle = middle(i % photo.width, i / photo.width);
        let ray = photo.ray(own_middle);
        let depth = found_here.plane.depth;
        let x = photo.eye + ray * depth;
        let agrees = |other: &usize| {
            let (there, found) = (&photos[*other], &found[*other]);
            let u = there.project(x)?;
            let [x, y] = there.pixel(u)?;
            let j = there.index(x, y);
            let found = found[j].filter(|found| found.cost < LARGEST_COST)?;
            let ray = there.ray(u);
            let depth_there = found.plane.depth_at(there.ray(middle(x, y)), ray);
            let back = there.eye + ray * depth_there;
            let near = photo.project(back)?.distance(own_middle) < PIXELS;
            (near && (photo.depth(back) - depth).abs() < DEPTH * depth).then_some(())
        };
        let count = others.iter().filter(|other| agrees(other).is_some()).take(AGREEING).count();
        (count == AGREEING).then(|| depth * ray.length())
    };
    (0..photo.width * photo.height).map(|i| distance(i).unwrap_or(0.0)).collect()
}
