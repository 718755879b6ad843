//! The picture behind an object that turns in front of a fixed camera.

use dataset::View;
use field::{Background, BackgroundRay, FilmPlace, RayAdjoint, Sphere};
use film::{Film, srgb_encode};
use glam::{DVec2, Vec3};
use rayon::prelude::*;

use crate::BackgroundEstimate;
use crate::background::LEAST_SPREAD;
use crate::still::{Still, have_one_size, without};

/// The most views by which a pixel is judged; of more, evenly chosen ones.
const MOST_VIEWS: usize = 64;

/// Samples of a pixel belong together within this many spreads.
const WIDTH: f32 = 3.0;

/// A pixel is compared in the views that show the backdrop within 1/REACH of the longer side of the
/// film.
const REACH: usize = 64;

/// The least share of the views that must show a pixel's colour, and their least number. With
/// fewer, the object hides the pixel.
const LEAST_SHARE: f64 = 0.125;
const LEAST_SHOWING: usize = 3;

/// The levels of the picture: the coarsest has 1/2^(LEVELS − 1) of the size.
const LEVELS: usize = 10;

/// The picture that a fixed camera sees behind an object that turns in front of it: a colour for
/// each place on the film, the same in all views.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// The picture at full size, at a half, and so on.
    levels: Vec<Level>,
    /// The standard deviation of a pixel over the views, in display units.
    pub spread: f32,
    /// The factor of each channel by which each view shows the picture; those that it was estimated
    /// from. Empty for a picture that was read from a file.
    pub gains: Vec<[f32; 3]>,
}

/// The picture at one size.
#[derive(Clone, Debug, PartialEq)]
struct Level {
    image: Film,
    /// Whether photographs show each pixel, row-major. The others have colours of their neighbours.
    is_known: Vec<bool>,
}

impl Level {
    fn index(&self, film: &FilmPlace) -> usize {
        let along = |u: f64, side: u32, own: u32| {
            let place = u / f64::from(side) * f64::from(own);
            (place.max(0.0) as u32).min(own - 1) as usize
        };
        let [width, height] = film.size;
        let x = along(film.u.x, width, self.image.width);
        along(film.u.y, height, self.image.height) * self.image.width as usize + x
    }
}

impl Picture {
    /// The picture behind the object in these views: for each pixel, the mean of the colours of the
    /// most views that agree, among those that show the backdrop near it, without the exposures of
    /// the views. Pixels that the object hides in nearly all views get the colours of their
    /// neighbours, and do not count as known.
    ///
    /// `None` if there is no view, or the views have several sizes.
    pub fn of(views: &[View], sphere: &Sphere<f64>) -> Option<Self> {
        if views.is_empty() || !have_one_size(views) {
            return None;
        }
        let Still { spread, gains, .. } = Still::of(views, sphere);
        let gains = if gains.is_empty() { vec![[1.0; 3]; views.len()] } else { gains };
        let step = views.len().div_ceil(MOST_VIEWS);
        let chosen: Vec<(&View, [f32; 3])> =
            views.iter().zip(gains.iter().copied()).step_by(step).collect();
        let found = grow(&chosen, sphere, WIDTH * spread.max(LEAST_SPREAD));
        let [width, height] = [views[0].image.width, views[0].image.height];
        let is_known = found.iter().map(|own| own.showing != 0).collect();
        let pixels = found.into_iter().map(|own| own.color).collect();
        Self::new(Film { width, height, pixels }, is_known, spread, gains)
    }

    /// A picture of which some pixels are known, and the others are filled in. `is_known` has a
    /// flag for each pixel, row-major; `spread` is in display units.
    ///
    /// `None` if a size is 0 or the numbers of pixels and of flags do not belong together.
    pub fn new(
        image: Film,
        is_known: Vec<bool>,
        spread: f32,
        gains: Vec<[f32; 3]>,
    ) -> Option<Self> {
        let count = image.width as usize * image.height as usize;
        if count == 0 || image.pixels.len() != count || is_known.len() != count {
            return None;
        }
        let image = filled(image, &is_known);
        let mut levels = vec![Level { image, is_known }];
        while levels.len() < LEVELS {
            let Level { image, is_known } = &levels[levels.len() - 1];
            if image.width == 1 && image.height == 1 {
                break;
            }
            let flags = is_known.iter().map(|known| f32::from(u8::from(*known)));
            let known = Film::grey(image.width, image.height, flags).downscaled(2);
            let is_known = known.pixels.iter().map(|share| share[0] > 0.999).collect();
            levels.push(Level { image: image.downscaled(2), is_known });
        }
        Some(Picture { levels, spread, gains })
    }

    /// The picture at full size, linear RGB.
    pub fn image(&self) -> &Film {
        &self.levels[0].image
    }

    /// Whether each pixel is known, row-major.
    pub fn is_known(&self) -> &[bool] {
        &self.levels[0].is_known
    }

    /// The level whose size is the nearest to that of a film.
    fn level(&self, size: [u32; 2]) -> &Level {
        let off = |level: &&Level| {
            let ratio = f64::from(level.image.width) / f64::from(size[0]);
            (ratio.ln().abs() * 1e9) as u64
        };
        self.levels.iter().min_by_key(off).unwrap_or(&self.levels[0])
    }

    /// The colour at a place on a film of any size, linear RGB, and whether it is known. It is the
    /// same over a pixel of the photographs, or of a photograph at 1/2, 1/4 and so on of their
    /// size.
    pub fn at(&self, film: &FilmPlace) -> ([f32; 3], bool) {
        let level = self.level(film.size);
        let i = level.index(film);
        (level.image.pixels[i], level.is_known[i])
    }

    /// The probability in [0, 1] that pixel `i` of a photograph of this size, row-major, of this
    /// linear RGB shows the picture, as a function for many pixels. It is 0 where the picture is
    /// not known, and for a size that is not one of its levels. `view` is the number of a view that the picture was estimated from, for its
    /// exposure.
    pub fn probabilities_at(
        &self,
        size: [u32; 2],
        view: usize,
    ) -> impl Fn(usize, [f32; 3]) -> f32 + Sync + '_ {
        let level = self.level(size);
        let gain = self.gains.get(view).copied().unwrap_or([1.0; 3]);
        let is_level = [level.image.width, level.image.height] == size;
        move |i, rgb| {
            if !is_level || !level.is_known[i] {
                return 0.0;
            }
            let color = level.image.pixels[i];
            let own = BackgroundEstimate { color, spread: self.spread, confidence: 1.0 };
            own.probability(without(rgb, gain))
        }
    }

    /// [`probabilities_at`](Self::probabilities_at) full size.
    pub fn probabilities(&self, view: usize) -> impl Fn(usize, [f32; 3]) -> f32 + Sync + '_ {
        self.probabilities_at([self.image().width, self.image().height], view)
    }
}

impl Background<f32> for Picture {
    fn parameter_count(&self) -> usize {
        0
    }

    fn radiance(&self, rays: &[BackgroundRay<f32>], rgb: &mut [Vec3]) {
        rays.iter().zip(rgb).for_each(|(ray, rgb)| *rgb = self.at(&ray.film).0.into());
    }

    /// The picture is the same over a pixel, and stands still on the film: it does not depend on
    /// where the ray goes.
    fn ray_vjp(&self, _: &[BackgroundRay<f32>], _: &[Vec3], bars: &mut [RayAdjoint<f32>]) {
        bars.fill(RayAdjoint::zero());
    }

    fn parameter_vjp(&self, _: &[BackgroundRay<f32>], _: &[Vec3], _: &mut [f32]) {}
}

/// What is found about a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Shown {
    /// The colour of the backdrop, linear RGB.
    color: [f32; 3],
    /// A bit for each view that shows it. None for a pixel that is not known.
    showing: u64,
}

/// The backdrop of all pixels. `views` are at most 64, with their gains, and samples agree within
/// `width`, in display units.
///
/// It grows inwards from the border of the film and from the pixels whose rays miss the sphere in
/// most views. A pixel is compared in the views alone that show the backdrop near it: where the
/// object hides the backdrop in all views, many views of a plain object may agree about its own
/// colour, but not the few that show the backdrop beside it.
fn grow(views: &[(&View, [f32; 3])], sphere: &Sphere<f64>, width: f32) -> Vec<Shown> {
    let image = &views[0].0.image;
    let size @ [columns, rows] = [image.width as usize, image.height as usize];
    let least = ((LEAST_SHARE * views.len() as f64).ceil() as usize).max(LEAST_SHOWING);
    let of_pixel = |i: usize, among: u64| {
        let is_among = |number: &usize| among >> number & 1 == 1 && views[*number].0.is_used(i);
        let sample = |number: usize| {
            let (view, gain) = views[number];
            (number, without(view.image.pixels[i], gain))
        };
        let samples: Vec<_> = (0..views.len()).filter(is_among).map(sample).collect();
        let least = least.max(samples.len().div_ceil(2));
        densest(&samples, width, least)
    };
    let missing = |i: usize| {
        let u = DVec2::new((i % columns) as f64 + 0.5, (i / columns) as f64 + 0.5);
        let misses = |(view, _): &&(&View, [f32; 3])| {
            sphere.clip(view.camera.eye, view.camera.direction(u)).is_none()
        };
        let is_border =
            [0, columns - 1].contains(&(i % columns)) || [0, rows - 1].contains(&(i / columns));
        is_border || 2 * views.iter().filter(misses).count() > views.len()
    };
    let all = u64::MAX >> (64 - views.len());
    // The views among which each pixel was compared.
    let seeds = (0..columns * rows).into_par_iter();
    let mut tried: Vec<u64> = seeds.map(|i| if missing(i) { all } else { 0 }).collect();
    let first = tried.par_iter().enumerate();
    let mut found: Vec<Shown> =
        first.map(|(i, among)| of_pixel(i, *among).unwrap_or_default()).collect();
    loop {
        let showing: Vec<u64> = found.iter().map(|own| own.showing).collect();
        let near = united(&showing, size, (columns.max(rows) / REACH).max(1));
        let next = |(i, own): (usize, &Shown)| {
            let is_new = own.showing == 0 && near[i] != tried[i] && near[i] != 0;
            if is_new { of_pixel(i, near[i]) } else { None }
        };
        let added: Vec<Option<Shown>> = found.par_iter().enumerate().map(next).collect();
        tried.iter_mut().zip(&near).for_each(|(tried, near)| *tried |= near);
        if added.iter().all(Option::is_none) {
            return found;
        }
        let own = found.iter_mut().zip(added);
        own.for_each(|(own, added)| *own = added.unwrap_or(*own));
    }
}

/// The union of the sets of the pixels in a square with this margin around each pixel.
fn united(sets: &[u64], [columns, rows]: [usize; 2], margin: usize) -> Vec<u64> {
    let around = |i: usize, side: usize| i.saturating_sub(margin)..(i + margin + 1).min(side);
    let place = |i: usize| [i % columns, i / columns];
    let in_row = |i: usize| {
        let [x, y] = place(i);
        around(x, columns).fold(0, |union, x| union | sets[y * columns + x])
    };
    let along: Vec<u64> = (0..sets.len()).into_par_iter().map(in_row).collect();
    let in_column = |i: usize| {
        let [x, y] = place(i);
        around(y, rows).fold(0, |union, y| union | along[y * columns + x])
    };
    (0..sets.len()).into_par_iter().map(in_column).collect()
}

/// The mean of the colours around the one with the most others within `width` of it, in display
/// units and in each channel; `None` if these are fewer than `least`. Samples are numbers of views
/// and linear RGB.
fn densest(samples: &[(usize, [f32; 3])], width: f32, least: usize) -> Option<Shown> {
    let all: Vec<[f32; 3]> = samples.iter().map(|(_, rgb)| rgb.map(srgb_encode)).collect();
    let is_near = |a: &[f32; 3], b: &[f32; 3]| (0..3).all(|c| (a[c] - b[c]).abs() <= width);
    let count = |own: &[f32; 3]| all.iter().filter(|other| is_near(own, other)).count();
    let (mut best, mut most) = (0, 0);
    for (i, own) in all.iter().enumerate() {
        let count = count(own);
        if count > most {
            (best, most) = (i, count);
        }
    }
    if most < least.max(1) {
        return None;
    }
    let near = samples.iter().zip(&all).filter(|(_, own)| is_near(own, &all[best]));
    let (mut sum, mut showing) = (Vec3::ZERO, 0);
    for ((number, rgb), _) in near {
        sum += Vec3::from(*rgb);
        showing |= 1u64 << number;
    }
    Some(Shown { color: (sum / most as f32).to_array(), showing })
}

/// The image with colours for the pixels that are not known: means over the known pixels of ever
/// larger blocks.
fn filled(mut image: Film, is_known: &[bool]) -> Film {
    if is_known.iter().all(|known| *known) {
        return image;
    }
    let (width, height) = (image.width, image.height);
    let flags = is_known.iter().map(|known| f32::from(u8::from(*known)));
    let share = Film::grey(width, height, flags);
    for (pixel, share) in image.pixels.iter_mut().zip(&share.pixels) {
        *pixel = pixel.map(|v| v * share[0]);
    }
    let known = image.clone();
    let mut n = 2;
    let mut left: Vec<usize> = (0..is_known.len()).filter(|i| !is_known[*i]).collect();
    while !left.is_empty() && n < 2 * width.max(height) {
        let (colors, shares) = (known.downscaled(n), share.downscaled(n));
        left.retain(|i| {
            let (x, y) = (*i as u32 % width / n, *i as u32 / width / n);
            let weight = shares.at(x, y)[0];
            if weight > 0.0 {
                image.pixels[*i] = colors.at(x, y).map(|v| v / weight);
            }
            weight == 0.0
        });
        n *= 2;
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_colour_of_a_pixel_is_that_of_the_most_views_that_agree() {
        // The object shows another grey in each view; six of 20 views show the backdrop.
        let shown = |i: usize| match i % 3 {
            0 if i < 18 => (i, [0.2 + 0.001 * i as f32, 0.4, 0.6]),
            _ => (i, [0.03 * i as f32 + 0.05; 3]),
        };
        let samples: Vec<_> = (0..20).map(shown).collect();
        let Shown { color, showing } = densest(&samples, 0.03, 3).unwrap();
        assert!((color[0] - 0.2075).abs() < 1e-3 && (color[2] - 0.6).abs() < 1e-3, "{color:?}");
        assert_eq!(showing, 0b1001001001001001);
        // No two views agree.
        let grey = |i: usize| (i, [0.05 * i as f32; 3]);
        assert_eq!(densest(&(0..20).map(grey).collect::<Vec<_>>(), 0.02, 3), None);
        assert_eq!(densest(&[], 0.02, 0), None);
    }

    #[test]
    fn a_plain_object_that_hides_pixels_in_most_views_is_no_part_of_the_picture() {
        // A grey disc turns off the middle of the film: it hides what is around in more than half
        // of the views.
        let backdrop = |x: u32, y: u32| [0.1 + 0.02 * (x % 7) as f32, 0.1 + 0.02 * y as f32, 0.4];
        let camera = crate::test_ball::cameras(1)[0].resized(32, 32);
        let view = |number: usize| {
            let angle = 0.3 * number as f64;
            let middle = DVec2::splat(16.0) + 4.0 * DVec2::new(angle.cos(), angle.sin());
            let pixel = |i: u32| {
                let (x, y) = (i % 32, i / 32);
                let is_object = DVec2::new(f64::from(x), f64::from(y)).distance(middle) < 7.0;
                if is_object { [0.5; 3] } else { backdrop(x, y) }
            };
            let image = Film { width: 32, height: 32, pixels: (0..1024).map(pixel).collect() };
            View { name: String::new(), path: Default::default(), camera, image, mask: None }
        };
        let views: Vec<View> = (0..21).map(view).collect();
        let sphere = crate::test_ball::ball().scaled(1.5);
        let picture = Picture::of(&views, &sphere).unwrap();
        for (i, is_known) in picture.is_known().iter().enumerate() {
            let (x, y) = (i as u32 % 32, i as u32 / 32);
            let away = DVec2::new(f64::from(x), f64::from(y)).distance(DVec2::splat(16.0));
            if away > 5.0 {
                let found = picture.image().at(x, y);
                let expected = backdrop(x, y);
                assert!(
                    (0..3).all(|c| (found[c] - expected[c]).abs() < 1e-4),
                    "{x}, {y}: {found:?}"
                );
                assert!(is_known, "{x}, {y}");
            }
        }
    }

    #[test]
    fn unknown_pixels_have_the_colours_of_their_neighbours_and_levels_those_of_reduced_photographs()
    {
        let pixel = |i: usize| [0.1 * (i % 5) as f32, 0.1 * (i / 5) as f32, 0.5];
        let mut pixels: Vec<[f32; 3]> = (0..25).map(pixel).collect();
        pixels[12] = [0.9, 0.9, 0.9];
        let image = Film { width: 5, height: 5, pixels };
        let is_known = (0..25).map(|i| i != 12).collect();
        let picture = Picture::new(image, is_known, 0.01, Vec::new()).unwrap();
        let middle = picture.image().pixels[12];
        assert!((middle[0] - 0.2667).abs() < 1e-3 && middle[2] == 0.5, "{middle:?}");
        let reduced = picture.image().downscaled(2);
        for (size, image) in [([5, 5], picture.image()), ([3, 3], &reduced)] {
            for (i, expected) in image.pixels.iter().enumerate() {
                let (x, y) = (i as u32 % size[0], i as u32 / size[0]);
                let u = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                let is_middle = u.floor() == DVec2::splat(if size[0] == 5 { 2.0 } else { 1.0 });
                let (found, is_known) = picture.at(&FilmPlace { u, size });
                assert_eq!((found, is_known), (*expected, !is_middle), "{u}");
                // Anywhere in the pixel.
                let corner = FilmPlace { u: u - 0.49, size };
                assert_eq!(picture.at(&corner).0, *expected);
            }
        }
        assert!(Picture::new(Film::new(2, 2), vec![true; 3], 0.01, Vec::new()).is_none());
    }

    #[test]
    fn a_ray_shows_its_pixel_and_an_unknown_one_is_never_certain() {
        let image = Film { width: 2, height: 1, pixels: vec![[0.2; 3], [0.4; 3]] };
        let picture = Picture::new(image, vec![true, false], 0.01, vec![[2.0; 3]]).unwrap();
        let ray = |x: f64, camera| BackgroundRay {
            camera,
            film: FilmPlace { u: DVec2::new(x, 0.5), size: [2, 1] },
            origin: Vec3::ZERO,
            direction: Vec3::Y,
        };
        let mut rgb = [Vec3::ZERO; 3];
        // An unknown pixel has the colour of its neighbour.
        picture.radiance(&[ray(0.5, 0), ray(0.1, 1), ray(1.5, 0)], &mut rgb);
        assert_eq!(rgb, [Vec3::splat(0.2); 3]);
        // The first view was photographed with twice the exposure.
        let probability = picture.probabilities(0);
        assert!(probability(0, [0.4; 3]) > 0.99 && probability(0, [0.2; 3]) < 0.01);
        assert_eq!(probability(1, [0.8; 3]), 0.0);
    }
}
