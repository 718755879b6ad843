//! The image pyramid: the photographs at several sizes, and their pixels whose rays meet the
//! bounding sphere.

use dataset::View;
use glam::DVec2;
use random::{Name, Stream};
use rayon::prelude::*;
use render::{Camera, Sample};

use crate::photometry::background::BackgroundModel;
use crate::photometry::margin::with_margin;
use crate::photometry::masks::MaskUse;
use crate::photometry::photograph::{Draw, Photograph};

/// The smallest side that a level of the pyramid may have, in pixels.
const SMALLEST_SIDE: u32 = 24;

const PERMUTATION: Name = Name::new("rounds of a permutation of pixels", 11);
const BACKGROUND_PIXEL: Name = Name::new("pixel that stands for a group of background pixels", 12);

/// One level of the pyramid: all views at one size.
#[derive(Clone, Debug)]
pub struct Level {
    /// The camera of every view, at this size.
    pub cameras: Vec<Camera>,
    /// The photograph of every view, at this size.
    pub photographs: Vec<Photograph>,
    /// The pixels of all views whose rays meet the bounding sphere, without those in `background`.
    foreground: Vec<Draw>,
    /// The pixels of all views that are certain background: in front of a uniform background, those
    /// that show it; if the background is trained, those whose rays miss the bounding sphere, and
    /// later those that are far from the surface.
    background: Vec<Draw>,
}

impl Level {
    fn new(cameras: Vec<Camera>, photographs: Vec<Photograph>, model: &BackgroundModel) -> Self {
        let uses = cameras.par_iter().zip(&photographs).enumerate();
        let uses =
            uses.map(|(view, (camera, photograph))| uses_of(view, camera, photograph, model));
        let uses: Vec<Vec<Use>> = uses.collect();
        let list = |wanted: Use| {
            let count = uses.iter().flatten().filter(|own| **own == wanted).count();
            let mut list = Vec::with_capacity(count);
            for (view, (own, camera)) in (0..).zip(uses.iter().zip(&cameras)) {
                let places = (0..camera.height as u16)
                    .flat_map(|y| (0..camera.width as u16).map(move |x| (x, y)));
                let wanted = own.iter().zip(places).filter(|(own, _)| **own == wanted);
                list.extend(wanted.map(|(_, (x, y))| Draw { view, x, y, count: 1 }));
            }
            list
        };
        let (foreground, background) =
            rayon::join(|| list(Use::Foreground), || list(Use::Background));
        Level { cameras, photographs, foreground, background }
    }

    /// The next level, at half the size.
    fn halved(&self, model: &BackgroundModel) -> Self {
        let photographs: Vec<Photograph> =
            self.photographs.par_iter().map(|photograph| photograph.downscaled(2)).collect();
        // If a side is odd, its last pixel averages fewer pixels.
        let cameras = self
            .cameras
            .iter()
            .zip(&photographs)
            .map(|(c, Photograph { image, .. })| c.reduced(2, image.width, image.height))
            .collect();
        Level::new(cameras, photographs, model)
    }

    /// Takes the pixels that are far from the surface for certain background, and no others: one
    /// draw can stand for several of them. `is_far` has a flag for each pixel of the photographs at
    /// 1/`factor` of their width and height, rounded up: view after view, row-major.
    ///
    /// # Panics
    /// If the number of flags is wrong.
    pub fn group(&mut self, is_far: &[bool], factor: u32) {
        let mut begins = vec![0];
        let widths: Vec<usize> = self
            .photographs
            .iter()
            .map(|photograph| {
                let [width, height] = photograph.size().map(|side| side.div_ceil(factor) as usize);
                begins.push(begins[begins.len() - 1] + width * height);
                width
            })
            .collect();
        assert_eq!(begins.last(), Some(&is_far.len()), "one flag for each pixel");
        let is_far = |draw: &Draw| {
            let [x, y] = [draw.x, draw.y].map(|v| (u32::from(v) / factor) as usize);
            let view = draw.view as usize;
            is_far[begins[view] + y * widths[view] + x]
        };
        let mut near = std::mem::take(&mut self.foreground);
        near.append(&mut self.background);
        near.sort_unstable_by_key(|pixel| (pixel.view, pixel.y, pixel.x));
        let mut far = Vec::with_capacity(near.iter().filter(|pixel| is_far(pixel)).count());
        near.retain(|pixel| {
            let is_far = is_far(pixel);
            if is_far {
                far.push(*pixel);
            }
            !is_far
        });
        (self.foreground, self.background) = (near, far);
    }

    /// For each pixel of the photographs, view after view, row-major, whether it and all pixels in
    /// a square with this margin around it are flagged.
    ///
    /// # Panics
    /// If the number of flags is wrong.
    pub fn with_margin(&self, flags: &[bool], margin: u32) -> Vec<bool> {
        assert_eq!(flags.len() as u64, self.photograph_pixels(), "one flag for each pixel");
        let mut rest = flags;
        let flags = self.photographs.iter().flat_map(|photograph| {
            let (own, others) = rest.split_at(photograph.image.pixels.len());
            rest = others;
            with_margin(own, photograph.size(), margin)
        });
        flags.collect()
    }

    /// The centres of all pixels of a photograph, row-major.
    ///
    /// # Panics
    /// If there is no such view.
    pub fn centers_of(&self, view: usize) -> Vec<Sample> {
        let [width, height] = self.photographs[view].size();
        let center = |x, y| Draw { view: view as u32, x, y, count: 1 }.center();
        let row = |y| (0..width as u16).map(move |x| center(x, y));
        (0..height as u16).flat_map(row).collect()
    }

    /// The centres of all pixels that are drawn.
    pub fn centers(&self) -> impl Iterator<Item = Sample> + '_ {
        self.foreground.iter().chain(&self.background).map(Draw::center)
    }

    /// The number of pixels of all photographs.
    pub fn photograph_pixels(&self) -> u64 {
        self.photographs.iter().map(|photograph| photograph.image.pixels.len() as u64).sum()
    }

    /// The number of pixels that are drawn.
    pub fn pixel_count(&self) -> usize {
        self.foreground.len() + self.background.len()
    }

    /// The number of draws that stand for every pixel once, if one of `every` certain background
    /// pixels is drawn.
    fn draws(&self, every: usize) -> usize {
        self.foreground.len() + self.background.len().div_ceil(every)
    }

    /// The number of draws that stand for about `pixels` pixels.
    pub fn draws_for(&self, pixels: u64, every: usize) -> u64 {
        (pixels as f64 * self.draws(every) as f64 / self.pixel_count() as f64).round().max(1.0)
            as u64
    }

    /// The number of pixels that `draws` draws stand for on average.
    pub fn count_of(&self, draws: u64, every: usize) -> f64 {
        draws as f64 * self.pixel_count() as f64 / self.draws(every) as f64
    }

    /// Draw number `draw` of an endless sequence of random permutations.
    ///
    /// A permutation has every foreground pixel, and one random pixel of each group of `every`
    /// certain background pixels, which stands for its group. The expectation of the mean over
    /// draws, weighted by `count`, is the mean over all pixels.
    pub fn draw(&self, draw: u64, every: usize, stream: Stream) -> Draw {
        let n = self.draws(every) as u64;
        let stream = stream.at(draw / n);
        let i = permute(draw % n, n, stream) as usize;
        if i < self.foreground.len() {
            return self.foreground[i];
        }
        let from = (i - self.foreground.len()) * every;
        let group = &self.background[from..(from + every).min(self.background.len())];
        let random = stream.named(BACKGROUND_PIXEL).at(i as u64);
        let one = random.bits() as usize % group.len();
        Draw { count: group.len() as u16, ..group[one] }
    }
}

/// The list of a level that a pixel is in.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Use {
    None,
    Foreground,
    Background,
}

/// The list of each pixel of a view, row-major.
fn uses_of(
    view: usize,
    camera: &Camera,
    photograph: &Photograph,
    model: &BackgroundModel,
) -> Vec<Use> {
    let certain = model.certain(view, photograph).into_iter();
    let places = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y)));
    let use_of = |(certain, (x, y)): (bool, (u32, u32))| {
        let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let meets = model.bounds.clip(camera.eye, camera.direction(center)).is_some();
        if !photograph.is_used(x, y) || !(meets || model.is_trained) {
            Use::None
        } else if certain || !meets {
            Use::Background
        } else {
            Use::Foreground
        }
    };
    certain.zip(places).map(use_of).collect()
}

/// The image of `i` under a pseudo-random permutation of 0..n: a Feistel network of four rounds on
/// the next power of four, applied until the result is below n.
///
/// Black and Rogaway, "Ciphers with Arbitrary Finite Domains", CT-RSA 2002: "cycle walking".
fn permute(i: u64, n: u64, stream: Stream) -> u64 {
    let half_bits = (64 - (n - 1).leading_zeros()).div_ceil(2).max(1);
    let mask = (1u64 << half_bits) - 1;
    let stream = stream.named(PERMUTATION);
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
/// It ends before a level with a side below `SMALLEST_SIDE`, or without a pixel whose ray meets
/// the bounding sphere.
pub fn pyramid(
    views: &[View],
    masks: MaskUse,
    model: &BackgroundModel,
    levels: usize,
) -> Vec<Level> {
    let cameras = views.iter().map(|v| v.camera).collect();
    let photographs = views.par_iter().map(|view| Photograph::new(view, masks)).collect();
    let mut out = vec![Level::new(cameras, photographs, model)];
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
    use dataset::{Mask, MaskKind};
    use field::Sphere;
    use film::Film;
    use glam::DVec3;
    use inspect::BackgroundEstimate;

    use super::*;

    #[test]
    fn permutations_have_every_number_once_and_depend_on_the_seed() {
        for n in [1u64, 2, 3, 17, 1000] {
            let mut seen: Vec<u64> = (0..n).map(|i| permute(i, n, Stream::of_seed(42))).collect();
            seen.sort_unstable();
            assert_eq!(seen, (0..n).collect::<Vec<_>>());
        }
        assert_ne!(
            (0..50).map(|i| permute(i, 50, Stream::of_seed(1))).collect::<Vec<_>>(),
            (0..50).map(|i| permute(i, 50, Stream::of_seed(2))).collect::<Vec<_>>()
        );
    }

    #[test]
    fn pixels_to_leave_out_are_not_drawn_on_any_level() {
        let (focal, middle) = (DVec2::splat(96.0), DVec2::splat(48.0));
        let camera =
            Camera::look_at(96, 96, focal, middle, DVec3::Z * 3.0, DVec3::ZERO, DVec3::Y).unwrap();
        // The columns 31 and later are used: on level 1, those from 16 on, all of whose pixels are.
        let values = (0..96 * 96).map(|i| f32::from(u8::from(i % 96 >= 31))).collect();
        let view = View {
            name: String::new(),
            path: "0.png".into(),
            camera,
            image: Film::new(96, 96),
            mask: Some(Mask { kind: MaskKind::Used, values }),
        };
        let model = BackgroundModel {
            bounds: Sphere { center: DVec3::ZERO, radius: 1.0 },
            estimates: vec![BackgroundEstimate { confidence: 0.0, ..BackgroundEstimate::NOTHING }],
            picture: None,
            is_trained: true,
        };
        let columns = |masks| -> Vec<u16> {
            let levels = pyramid(std::slice::from_ref(&view), masks, &model, 2);
            let least = |l: &Level| l.foreground.iter().chain(&l.background).map(|p| p.x).min();
            levels.iter().map(|level| least(level).unwrap()).collect()
        };
        assert_eq!(columns(MaskUse::LeaveOut), [31, 16]);
        assert_eq!(columns(MaskUse::None), [0, 0]);
    }

    #[test]
    fn grouped_pixels_are_those_of_the_flags_and_a_margin_shrinks_them() {
        let camera = |side: u32| {
            let (focal, middle) = (DVec2::splat(2.0), DVec2::splat(f64::from(side) / 2.0));
            Camera::look_at(side, side, focal, middle, DVec3::Z * 3.0, DVec3::ZERO, DVec3::Y)
        };
        let model = BackgroundModel {
            bounds: Sphere { center: DVec3::ZERO, radius: 1.0 },
            estimates: vec![BackgroundEstimate { confidence: 0.0, ..BackgroundEstimate::NOTHING }],
            picture: None,
            is_trained: true,
        };
        let level = |sides: [u32; 2]| {
            let photograph = |side| Photograph::of_image(Film::new(side, side));
            let cameras = sides.map(|side| camera(side).unwrap()).to_vec();
            Level::new(cameras, sides.map(photograph).into(), &model)
        };
        // Photographs of 3 × 3 and 5 × 5 pixels have 2 × 2 and 3 × 3 flags.
        let mut finest = level([3, 5]);
        for far in 0..13 {
            let flags: Vec<bool> = (0..13).map(|i| i == far).collect();
            finest.group(&flags, 2);
            assert_eq!(finest.pixel_count(), 9 + 25);
            let of = |p: &Draw| match p.view {
                0 => p.y / 2 * 2 + p.x / 2,
                _ => 4 + p.y / 2 * 3 + p.x / 2,
            };
            assert!(!finest.background.is_empty());
            assert!(finest.background.iter().all(|p| of(p) == far));
            assert!(finest.foreground.iter().all(|p| of(p) != far));
        }
        let coarse = level([2, 3]);
        assert_eq!([0, 1].map(|view| coarse.centers_of(view).len()), [4, 9]);
        let third = coarse.centers_of(1)[2];
        assert_eq!((third.camera, third.u), (1, DVec2::new(2.5, 0.5)));
        let flags: Vec<bool> = (0..13).map(|i| i != 4).collect();
        let inside = coarse.with_margin(&flags, 1);
        let expected = |i| i < 4 || [6, 9, 10, 11, 12].contains(&i);
        assert_eq!(inside, (0..13).map(expected).collect::<Vec<bool>>());
    }
}
