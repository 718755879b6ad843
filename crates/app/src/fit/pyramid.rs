//! The photographs at several sizes, and which of their pixels can see the object.

use field::Sphere;
use glam::DVec2;

use crate::camera::Camera;
use crate::data::View;
use crate::film::Film;
use crate::sampler::mix;

/// The smallest side that a level of the pyramid may have, in pixels.
const SMALLEST_SIDE: u32 = 24;

/// All views at one size.
pub(crate) struct Level {
    /// The camera of every view, at this size.
    pub(crate) cameras: Vec<Camera>,
    /// The image of every view, at this size.
    pub(crate) images: Vec<Film>,
    /// Masks at this size, where views have them.
    pub(crate) masks: Vec<Option<Film>>,
    /// The pixels whose rays meet the bounding sphere, over all views.
    pixels: Vec<Pixel>,
}

/// A pixel of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Pixel {
    /// The view.
    pub(crate) view: u32,
    /// The column.
    pub(crate) x: u16,
    /// The row.
    pub(crate) y: u16,
}

impl Level {
    fn new(cameras: Vec<Camera>, images: Vec<Film>, masks: Vec<Option<Film>>, bounds: &Sphere<f64>) -> Self {
        let mut pixels = Vec::new();
        for (view, camera) in cameras.iter().enumerate() {
            for y in 0..camera.height as u16 {
                for x in 0..camera.width as u16 {
                    let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    if bounds.clip(camera.eye, camera.direction(center)).is_some() {
                        pixels.push(Pixel { view: view as u32, x, y });
                    }
                }
            }
        }
        Level { cameras, images, masks, pixels }
    }

    /// Half the size.
    fn halved(&self, bounds: &Sphere<f64>) -> Self {
        let images: Vec<Film> = self.images.iter().map(Film::halved).collect();
        let masks = self.masks.iter().map(|m| m.as_ref().map(Film::halved)).collect();
        // An odd side leaves a last pixel of half the width: the camera's scale stays exactly 1/2.
        let cameras = self
            .cameras
            .iter()
            .zip(&images)
            .map(|(c, image)| Camera {
                width: image.width,
                height: image.height,
                focal: c.focal / 2.0,
                principal: c.principal / 2.0,
                ..*c
            })
            .collect();
        Level::new(cameras, images, masks, bounds)
    }

    /// The number of pixels that can see the object.
    pub(crate) fn pixel_count(&self) -> usize {
        self.pixels.len()
    }

    /// Pixel number `draw` of an endless sequence of random permutations of all pixels.
    pub(crate) fn draw(&self, draw: u64, seed: u64) -> Pixel {
        let n = self.pixels.len() as u64;
        self.pixels[permute(draw % n, n, mix(seed, draw / n)) as usize]
    }
}

/// The image of `i` under a pseudo-random permutation of 0..n: a four-round Feistel network on the next power of four,
/// walked until it lands inside.
fn permute(i: u64, n: u64, seed: u64) -> u64 {
    let half_bits = (64 - (n - 1).leading_zeros()).div_ceil(2).max(1);
    let mask = (1u64 << half_bits) - 1;
    let mut value = i;
    loop {
        let (mut left, mut right) = (value >> half_bits, value & mask);
        for round in 0..4 {
            (left, right) = (right, left ^ (mix(seed.wrapping_add(round), right) & mask));
        }
        value = left << half_bits | right;
        if value < n {
            return value;
        }
    }
}

/// The pyramid: level 0 is full size, each further one half of it.
pub(crate) fn pyramid(views: &[View], bounds: &Sphere<f64>, levels: usize) -> Vec<Level> {
    let masks = views.iter().map(|v| {
        v.mask.as_ref().map(|mask| Film {
            width: v.image.width,
            height: v.image.height,
            pixels: mask.iter().map(|&m| [m; 3]).collect(),
        })
    });
    let cameras = views.iter().map(|v| v.camera).collect();
    let images = views.iter().map(|v| v.image.clone()).collect();
    let mut out = vec![Level::new(cameras, images, masks.collect(), bounds)];
    while out.len() < levels {
        let last = &out[out.len() - 1];
        if last.images.iter().any(|i| i.width.min(i.height) < 2 * SMALLEST_SIDE) {
            break;
        }
        let next = last.halved(bounds);
        // A small sphere may fall between the centres of large pixels.
        if next.pixels.is_empty() {
            break;
        }
        out.push(next);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn permutations_visit_everything_once() {
        for n in [1u64, 2, 3, 17, 1000] {
            let mut seen: Vec<u64> = (0..n).map(|i| permute(i, n, 42)).collect();
            seen.sort_unstable();
            assert_eq!(seen, (0..n).collect::<Vec<_>>());
        }
        assert_ne!(
            (0..50).map(|i| permute(i, 50, 1)).collect::<Vec<_>>(),
            (0..50).map(|i| permute(i, 50, 2)).collect::<Vec<_>>()
        );
    }
}
