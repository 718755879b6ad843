//! The photographs at several sizes, and which of their pixels can see the object.

use field::Sphere;
use glam::DVec2;

use dataset::{Background, View};
use film::Film;
use random::mix;
use render::Camera;

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
    /// The pixels whose rays meet the bounding sphere, over all views, but for the plain ones.
    busy: Vec<Pixel>,
    /// Those of them that look like background and nothing else.
    plain: Vec<Pixel>,
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
    /// The number of pixels that it stands for.
    pub(crate) count: u16,
}

/// How sure a pixel and those around it must be background to be plain.
const SURE: f32 = 0.99;

/// How far around, as a part of the image: silhouettes settle there.
const APART: u32 = 32;

/// The confidence above which there is a background to speak of.
const KNOWN: f32 = 0.5;

/// What tells of the background.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Backdrop {
    /// The object may be anywhere inside.
    pub(crate) bounds: Sphere<f64>,
    /// How the background looks.
    pub(crate) background: Background,
    /// Whether masks, where there are some, say what is background.
    pub(crate) use_masks: bool,
}

impl Backdrop {
    /// The probability that a pixel shows the background.
    pub(crate) fn probability(&self, image: &Film, mask: Option<&Film>, x: u32, y: u32) -> f32 {
        match mask.filter(|_| self.use_masks) {
            Some(mask) => 1.0 - mask.at(x, y)[0],
            None => self.background.probability(image.at(x, y)),
        }
    }

    /// Whether each pixel and those around it show the background for sure, row-major.
    fn plain(&self, image: &Film, mask: Option<&Film>) -> Vec<bool> {
        let (width, height) = (image.width, image.height);
        let known = self.background.confidence > KNOWN || (self.use_masks && mask.is_some());
        let all = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let sure: Vec<bool> =
            all().map(|(x, y)| known && self.probability(image, mask, x, y) > SURE).collect();
        let margin = (width.max(height) / APART).max(1);
        let near = |v: u32, side: u32| v.saturating_sub(margin)..=(v + margin).min(side - 1);
        // A square is a row of columns.
        let columns: Vec<bool> =
            all().map(|(x, y)| near(y, height).all(|y| sure[(y * width + x) as usize])).collect();
        all().map(|(x, y)| near(x, width).all(|x| columns[(y * width + x) as usize])).collect()
    }
}

impl Level {
    fn new(
        cameras: Vec<Camera>,
        images: Vec<Film>,
        masks: Vec<Option<Film>>,
        backdrop: &Backdrop,
    ) -> Self {
        let (mut busy, mut plain) = (Vec::new(), Vec::new());
        for (view, camera) in cameras.iter().enumerate() {
            let mut is_plain = backdrop.plain(&images[view], masks[view].as_ref()).into_iter();
            for y in 0..camera.height as u16 {
                for x in 0..camera.width as u16 {
                    let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let list = if is_plain.next() == Some(true) { &mut plain } else { &mut busy };
                    if backdrop.bounds.clip(camera.eye, camera.direction(center)).is_some() {
                        list.push(Pixel { view: view as u32, x, y, count: 1 });
                    }
                }
            }
        }
        Level { cameras, images, masks, busy, plain }
    }

    /// Half the size.
    fn halved(&self, backdrop: &Backdrop) -> Self {
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
        Level::new(cameras, images, masks, backdrop)
    }

    /// The number of pixels that can see the object.
    pub(crate) fn pixel_count(&self) -> usize {
        self.busy.len() + self.plain.len()
    }

    /// The number of draws that stand for every pixel once, if one in `every` of the plain ones is
    /// drawn.
    fn draws(&self, every: usize) -> usize {
        self.busy.len() + self.plain.len().div_ceil(every)
    }

    /// The number of draws that stand for about so many pixels.
    pub(crate) fn draws_for(&self, pixels: u64, every: usize) -> u64 {
        (pixels as f64 * self.draws(every) as f64 / self.pixel_count() as f64).round().max(1.0)
            as u64
    }

    /// The number of pixels that so many draws stand for on average.
    pub(crate) fn count_of(&self, draws: u64, every: usize) -> f64 {
        draws as f64 * self.pixel_count() as f64 / self.draws(every) as f64
    }

    /// Pixel number `draw` of an endless sequence of random permutations of all that is drawn: busy
    /// pixels, and of `every` plain ones one that stands for them all. The mean over draws, by
    /// count, is that over all pixels.
    pub(crate) fn draw(&self, draw: u64, every: usize, seed: u64) -> Pixel {
        let n = self.draws(every) as u64;
        let stream = mix(seed, draw / n);
        let i = permute(draw % n, n, stream) as usize;
        if i < self.busy.len() {
            return self.busy[i];
        }
        let from = (i - self.busy.len()) * every;
        let group = &self.plain[from..(from + every).min(self.plain.len())];
        let one = mix(stream, i as u64) as usize % group.len();
        Pixel { count: group.len() as u16, ..group[one] }
    }
}

/// The image of `i` under a pseudo-random permutation of 0..n: a four-round Feistel network on the
/// next power of four, walked until it lands inside.
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
pub(crate) fn pyramid(views: &[View], backdrop: &Backdrop, levels: usize) -> Vec<Level> {
    let masks = views.iter().map(|v| {
        v.mask.as_ref().map(|mask| Film {
            width: v.image.width,
            height: v.image.height,
            pixels: mask.iter().map(|&m| [m; 3]).collect(),
        })
    });
    let cameras = views.iter().map(|v| v.camera).collect();
    let images = views.iter().map(|v| v.image.clone()).collect();
    let mut out = vec![Level::new(cameras, images, masks.collect(), backdrop)];
    while out.len() < levels {
        let last = &out[out.len() - 1];
        if last.images.iter().any(|i| i.width.min(i.height) < 2 * SMALLEST_SIDE) {
            break;
        }
        let next = last.halved(backdrop);
        // A small sphere may fall between the centres of large pixels.
        if next.pixel_count() == 0 {
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
