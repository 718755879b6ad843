//! The image pyramid: the photographs at several sizes, and their pixels whose rays meet the
//! bounding sphere.

use dataset::View;
use film::Film;
use glam::DVec2;
use random::{Purpose, Stream};
use render::{Camera, Sample};

use crate::background::BackgroundModel;

/// The smallest side that a level of the pyramid may have, in pixels.
const SMALLEST_SIDE: u32 = 24;

/// One level of the pyramid: all views at one size.
pub(crate) struct Level {
    /// The camera of every view, at this size.
    pub(crate) cameras: Vec<Camera>,
    /// The photograph of every view, at this size.
    pub(crate) photographs: Vec<Photograph>,
    /// The pixels of all views whose rays meet the bounding sphere, without those in `background`.
    foreground: Vec<Pixel>,
    /// The pixels of all views that are certain background: in front of a uniform background, those
    /// that show it; if the background is trained, those whose rays miss the bounding sphere.
    background: Vec<Pixel>,
}

/// The photograph of a view at one size.
pub(crate) struct Photograph {
    /// Its image.
    pub(crate) image: Film,
    /// Its mask, if the view has one.
    pub(crate) mask: Option<Film>,
}

impl Photograph {
    fn halved(&self) -> Self {
        Photograph { image: self.image.halved(), mask: self.mask.as_ref().map(Film::halved) }
    }
}

/// A drawn pixel of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Pixel {
    /// The index of the view.
    pub(crate) view: u32,
    /// The column.
    pub(crate) x: u16,
    /// The row.
    pub(crate) y: u16,
    /// The number of pixels that this draw stands for.
    pub(crate) count: u16,
}

impl Level {
    fn new(cameras: Vec<Camera>, photographs: Vec<Photograph>, model: &BackgroundModel) -> Self {
        let (mut foreground, mut background) = (Vec::new(), Vec::new());
        for (view, (camera, photograph)) in cameras.iter().zip(&photographs).enumerate() {
            let certain = model.certain(&photograph.image, photograph.mask.as_ref());
            let mut certain = certain.into_iter();
            for y in 0..camera.height as u16 {
                for x in 0..camera.width as u16 {
                    let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let meets = model.bounds.clip(camera.eye, camera.direction(center)).is_some();
                    let is_background = certain.next() == Some(true) || !meets;
                    let list = if is_background { &mut background } else { &mut foreground };
                    if meets || model.is_trained {
                        list.push(Pixel { view: view as u32, x, y, count: 1 });
                    }
                }
            }
        }
        Level { cameras, photographs, foreground, background }
    }

    /// The next level, at half the size.
    fn halved(&self, model: &BackgroundModel) -> Self {
        let photographs: Vec<Photograph> =
            self.photographs.iter().map(Photograph::halved).collect();
        // If a side is odd, its last pixel averages fewer pixels. The camera is scaled by exactly
        // 1/2.
        let cameras = self
            .cameras
            .iter()
            .zip(&photographs)
            .map(|(c, Photograph { image, .. })| Camera {
                width: image.width,
                height: image.height,
                focal: c.focal / 2.0,
                principal: c.principal / 2.0,
                ..*c
            })
            .collect();
        Level::new(cameras, photographs, model)
    }

    /// The centres of all pixels that are drawn.
    pub(crate) fn centers(&self) -> impl Iterator<Item = Sample> + '_ {
        let center = |p: &Pixel| Sample {
            camera: p.view as usize,
            u: DVec2::new(f64::from(p.x) + 0.5, f64::from(p.y) + 0.5),
        };
        self.foreground.iter().chain(&self.background).map(center)
    }

    /// The number of pixels that are drawn.
    pub(crate) fn pixel_count(&self) -> usize {
        self.foreground.len() + self.background.len()
    }

    /// The number of draws that stand for every pixel once, if one of `every` certain background
    /// pixels is drawn.
    fn draws(&self, every: usize) -> usize {
        self.foreground.len() + self.background.len().div_ceil(every)
    }

    /// The number of draws that stand for about `pixels` pixels.
    pub(crate) fn draws_for(&self, pixels: u64, every: usize) -> u64 {
        (pixels as f64 * self.draws(every) as f64 / self.pixel_count() as f64).round().max(1.0)
            as u64
    }

    /// The number of pixels that `draws` draws stand for on average.
    pub(crate) fn count_of(&self, draws: u64, every: usize) -> f64 {
        draws as f64 * self.pixel_count() as f64 / self.draws(every) as f64
    }

    /// Draw number `draw` of an endless sequence of random permutations.
    ///
    /// A permutation has every foreground pixel, and one random pixel of each group of `every`
    /// certain background pixels, which stands for its group. The expectation of the mean over
    /// draws, weighted by `count`, is the mean over all pixels.
    pub(crate) fn draw(&self, draw: u64, every: usize, stream: Stream) -> Pixel {
        let n = self.draws(every) as u64;
        let seed = stream.at(draw / n).bits();
        let i = permute(draw % n, n, seed) as usize;
        if i < self.foreground.len() {
            return self.foreground[i];
        }
        let from = (i - self.foreground.len()) * every;
        let group = &self.background[from..(from + every).min(self.background.len())];
        let random = Stream::new(seed, Purpose::BackgroundPixel).at(i as u64);
        let one = random.bits() as usize % group.len();
        Pixel { count: group.len() as u16, ..group[one] }
    }
}

/// The image of `i` under a pseudo-random permutation of 0..n: a Feistel network of four rounds on
/// the next power of four, applied until the result is below n.
///
/// Black and Rogaway, "Ciphers with Arbitrary Finite Domains", CT-RSA 2002: "cycle walking".
fn permute(i: u64, n: u64, seed: u64) -> u64 {
    let half_bits = (64 - (n - 1).leading_zeros()).div_ceil(2).max(1);
    let mask = (1u64 << half_bits) - 1;
    let stream = Stream::new(seed, Purpose::Permutation);
    let mut value = i;
    loop {
        let (mut left, mut right) = (value >> half_bits, value & mask);
        for round in 0..4 {
            (left, right) = (right, left ^ (stream.at(round).at(right).bits() & mask));
        }
        value = left << half_bits | right;
        if value < n {
            return value;
        }
    }
}

/// The pyramid of at most `levels` levels. Level 0 has the full size, each further level half the
/// size of the one before.
///
/// It ends before a level with a side below [`SMALLEST_SIDE`], or without a pixel whose ray meets
/// the bounding sphere.
pub(crate) fn pyramid(views: &[View], model: &BackgroundModel, levels: usize) -> Vec<Level> {
    let photograph = |view: &View| {
        let mask = view.mask.as_ref().map(|mask| Film {
            width: view.image.width,
            height: view.image.height,
            pixels: mask.iter().map(|&m| [m; 3]).collect(),
        });
        Photograph { image: view.image.clone(), mask }
    };
    let cameras = views.iter().map(|v| v.camera).collect();
    let mut out = vec![Level::new(cameras, views.iter().map(photograph).collect(), model)];
    while out.len() < levels {
        let last = &out[out.len() - 1];
        if last.photographs.iter().any(|p| p.image.width.min(p.image.height) < 2 * SMALLEST_SIDE) {
            break;
        }
        let next = last.halved(model);
        // A small bounding sphere may lie between the centres of the pixels.
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
    fn permutations_have_every_number_once_and_depend_on_the_seed() {
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
