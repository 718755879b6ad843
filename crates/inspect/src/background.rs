//! Estimation of a uniform background from the photographs.

use field::Sphere;
use glam::DVec2;
use rayon::prelude::*;

use dataset::View;
use film::{srgb_decode, srgb_encode};

/// A uniform background, and how well the photographs fit one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BackgroundEstimate {
    /// Its linear RGB.
    pub color: [f32; 3],
    /// A robust standard deviation of the background's pixels in display space (sRGB in [0, 1]),
    /// the largest of the three channels. It covers the tail of the distribution, for example a dim
    /// table in a black room.
    pub spread: f32,
    /// Uniformity in [0, 1]: 0 for clutter, 1 if nearly all pixels around the object have similar
    /// colours.
    pub confidence: f32,
}

/// The least spread, in display units: two steps of 8 bits, the noise of a clean render.
pub(crate) const LEAST_SPREAD: f32 = 2.0 / 255.0;

/// Pixels within this many spreads of the colour count as background. The spread is taken as at
/// least twice [`LEAST_SPREAD`] here.
const REACH: f32 = 4.0;

/// The median absolute deviation of a normal distribution, in standard deviations.
const MAD_PER_SIGMA: f32 = 0.6745;

/// The quantile of the distances that measures the tail.
const TAIL: f32 = 0.95;

/// The [`TAIL`] quantile of |x| for a normal distribution, in standard deviations.
const TAIL_PER_SIGMA: f32 = 1.96;

/// The least confidence with which a background counts as uniform.
pub(crate) const UNIFORM: f32 = 0.5;

/// The largest number of sigma-clipping steps.
const CLIPPINGS: usize = 8;

/// Pixels sampled on a regular grid of each view, about; the border is sampled in addition.
const SAMPLES: f64 = 4096.0;

/// The share of similar pixels at which the confidence starts to rise from 0, and the range over
/// which it rises to 1. A background that fits half of the pixels is none; beyond 90 %, the others
/// can be the object at the frame's border.
const LEAST_SHARE: f32 = 0.5;
const SHARE_RANGE: f32 = 0.4;

/// The least share of the surrounding pixels that masks must not leave out.
const LEAST_USED: f64 = 0.1;

/// The spread at which the confidence has fallen to 0 (clutter), and the range over which it falls
/// from 1; display units.
///
/// One colour for a backdrop with a vignette (a spread of 0.06) left a Chamfer distance of 18 % of
/// the bounding radius after 2,000 iterations; a volume left 1.9 %.
const MOST_SPREAD: f32 = 0.07;
const SPREAD_RANGE: f32 = 0.04;

impl BackgroundEstimate {
    /// Black: the background of photographs that are over black by their masks.
    pub const NOTHING: Self =
        BackgroundEstimate { color: [0.0; 3], spread: LEAST_SPREAD, confidence: 1.0 };

    /// Estimates the background from the pixels whose rays miss the sphere `candidate`, and from
    /// the pixels of the images' borders.
    ///
    /// Colour and spread are a median and a median absolute deviation, widened to the tail. They
    /// hold if more than half of these pixels show one colour. Several uniform colours (a wall and
    /// a table) count as clutter, which lowers the confidence. If masks leave out nearly all of the
    /// pixels, the confidence is 0.
    pub fn estimate(views: &[View], candidate: &Sphere<f64>) -> Self {
        let shown: Vec<Surrounding> =
            views.par_iter().map(|view| Surrounding::of(view, candidate)).collect();
        Self::of_surroundings(&shown)
    }

    /// See [`estimate`](Self::estimate), for the pixels of several views.
    pub(crate) fn of_surroundings(views: &[Surrounding]) -> Self {
        let all = views.iter().map(|view| view.all).sum::<usize>();
        let least = (LEAST_USED * all as f64) as usize;
        let pixels: Vec<[f32; 3]> =
            views.iter().flat_map(|view| view.used.iter().copied()).collect();
        if pixels.is_empty() || pixels.len() < least {
            return BackgroundEstimate { color: [0.0; 3], spread: LEAST_SPREAD, confidence: 0.0 };
        }
        let center: [f32; 3] =
            std::array::from_fn(|c| median(pixels.iter().map(|p| p[c]).collect()));
        let distances: Vec<f32> = pixels
            .iter()
            .map(|p| (0..3).map(|c| (p[c] - center[c]).abs()).fold(0.0, f32::max))
            .collect();
        let spread = with_tail(&distances, deviation(&pixels, center));
        let reach = reach(spread);
        let near = distances.iter().filter(|d| **d < reach).count();
        let share = near as f32 / pixels.len() as f32;
        let confidence = ((share - LEAST_SHARE) / SHARE_RANGE).clamp(0.0, 1.0)
            * ((MOST_SPREAD - spread) / SPREAD_RANGE).clamp(0.0, 1.0);
        BackgroundEstimate { color: center.map(srgb_decode), spread, confidence }
    }

    /// Like [`estimate`](Self::estimate), from one view alone.
    pub fn of_view(view: &View, candidate: &Sphere<f64>) -> Self {
        Self::estimate(std::slice::from_ref(view), candidate)
    }

    /// Whether the background counts as uniform: its confidence is at least 0.5.
    pub fn is_uniform(&self) -> bool {
        self.confidence >= UNIFORM
    }

    /// The probability in [0, 1] that a pixel of this linear RGB shows the background.
    ///
    /// By Bayes' rule in display space: the background is normal with standard deviation `spread`
    /// in each channel, the object is uniform over all colours, and both are equally likely before
    /// the pixel is known.
    pub fn probability(&self, rgb: [f32; 3]) -> f32 {
        self.probabilities()(rgb)
    }

    /// [`probability`](Self::probability) as a function, for many pixels.
    pub fn probabilities(&self) -> impl Fn([f32; 3]) -> f32 + Sync + use<> {
        let sigma = self.spread.max(LEAST_SPREAD);
        let color = self.color.map(srgb_encode);
        move |rgb| {
            let square: f32 =
                (0..3).map(|c| ((srgb_encode(rgb[c]) - color[c]) / sigma).powi(2)).sum();
            let density =
                (-0.5 * square).exp() / ((2.0 * std::f32::consts::PI).sqrt() * sigma).powi(3);
            density / (density + 1.0)
        }
    }
}

/// The standard deviation by the median absolute deviation, the largest of the channels and
/// [`LEAST_SPREAD`].
pub(crate) fn deviation(pixels: &[[f32; 3]], center: [f32; 3]) -> f32 {
    (0..3)
        .map(|c| median(pixels.iter().map(|p| (p[c] - center[c]).abs()).collect()) / MAD_PER_SIGMA)
        .fold(LEAST_SPREAD, f32::max)
}

/// The distance, in display space, below which a pixel counts as background.
pub(crate) fn reach(spread: f32) -> f32 {
    REACH * spread.max(2.0 * LEAST_SPREAD)
}

/// Widens the spread until it also explains the tail of the distances within reach. The reach grows
/// with the spread, so the step is repeated (sigma clipping) until the spread stays or
/// [`CLIPPINGS`] steps are done.
fn with_tail(distances: &[f32], spread: f32) -> f32 {
    let mut spread = spread;
    for _ in 0..CLIPPINGS {
        let mut near: Vec<f32> = distances.iter().copied().filter(|d| *d < reach(spread)).collect();
        if near.is_empty() {
            return spread;
        }
        let at = (TAIL * (near.len() - 1) as f32) as usize;
        let tail = *near.select_nth_unstable_by(at, f32::total_cmp).1 / TAIL_PER_SIGMA;
        if tail <= spread {
            return spread;
        }
        spread = tail;
    }
    spread
}

/// Pixels of a view that should show background.
pub(crate) struct Surrounding {
    /// Their number.
    all: usize,
    /// Those that masks do not leave out, in display space.
    used: Vec<[f32; 3]>,
}

impl Surrounding {
    pub(crate) fn of(view: &View, candidate: &Sphere<f64>) -> Self {
        let shown = |(x, y): (u32, u32)| {
            let is_used = view.is_used((y * view.image.width + x) as usize);
            is_used.then(|| view.image.at(x, y).map(srgb_encode))
        };
        let places = surrounding_places(view, candidate);
        Surrounding { all: places.len(), used: places.into_iter().filter_map(shown).collect() }
    }
}

/// The places, x and y, of pixels that should show background: those whose rays miss the sphere
/// `candidate`, and those of the border. A few thousand a view at most.
pub(crate) fn surrounding_places(view: &View, candidate: &Sphere<f64>) -> Vec<(u32, u32)> {
    let (width, height) = (view.image.width, view.image.height);
    let stride = (f64::from(width * height) / SAMPLES).sqrt().ceil().max(1.0) as u32;
    let mut places = Vec::new();
    for y in (0..height).step_by(stride as usize) {
        for x in (0..width).step_by(stride as usize) {
            let u = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            if candidate.clip(view.camera.eye, view.camera.direction(u)).is_none() {
                places.push((x, y));
            }
        }
    }
    for x in (0..width).step_by(stride as usize) {
        places.extend([(x, 0), (x, height - 1)]);
    }
    for y in (0..height).step_by(stride as usize) {
        places.extend([(0, y), (width - 1, y)]);
    }
    places
}

/// The median; of an even number of values, the upper of the middle two.
pub(crate) fn median(mut values: Vec<f32>) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_ball::{ball, cameras, photograph};
    use film::Film;

    /// Views of the ball over a background of the given display values.
    fn views(shown: impl Fn(u32, u32) -> [f32; 3]) -> Vec<View> {
        let of = |camera: render::Camera| {
            let mut image = photograph(&camera);
            let empty = image.at(0, 0);
            for (i, pixel) in image.pixels.iter_mut().enumerate().filter(|(_, p)| **p == empty) {
                *pixel = shown(i as u32 % camera.width, i as u32 / camera.width).map(srgb_decode);
            }
            View { name: String::new(), path: Default::default(), camera, image, mask: None }
        };
        cameras(6).into_iter().map(of).collect()
    }

    /// A hash of the pixel, uniform in [0, 1].
    fn noise(x: u32, y: u32) -> f32 {
        (x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(40_503)).wrapping_mul(2_246_822_519) as f32
            / u32::MAX as f32
    }

    #[test]
    fn the_background_colour_is_probable_and_others_are_not() {
        let background =
            BackgroundEstimate { color: [0.1, 0.2, 0.3], spread: 0.01, confidence: 1.0 };
        assert!(background.probability([0.1, 0.2, 0.3]) > 0.99);
        assert!(background.probability([0.3, 0.2, 0.1]) < 1e-6);
        assert!(background.probability([0.105, 0.205, 0.3]) > 0.9);
        for infinite in [f32::INFINITY, f32::NEG_INFINITY] {
            assert!(
                background.probability([infinite; 3]).partial_cmp(&0.5)
                    != Some(std::cmp::Ordering::Greater)
            );
        }
    }

    #[test]
    fn a_constant_background_has_the_least_spread() {
        let found = BackgroundEstimate::estimate(&views(|_, _| [0.4, 0.5, 0.6]), &ball());
        assert_eq!((found.spread, found.confidence), (LEAST_SPREAD, 1.0));
        for (found, shown) in found.color.into_iter().zip([0.4, 0.5, 0.6]) {
            assert!((srgb_encode(found) - shown).abs() < 1e-5);
        }
    }

    #[test]
    fn noise_widens_the_spread() {
        let noisy = BackgroundEstimate::estimate(
            &views(|x, y| [0.5 + 0.1 * (noise(x, y) - 0.5); 3]),
            &ball(),
        );
        // A uniform distribution of width 0.1: half of it lies within 0.025 of the middle, 95 %
        // within 0.0475.
        assert!((0.02..0.045).contains(&noisy.spread) && noisy.confidence > 0.8, "{noisy:?}");
    }

    #[test]
    fn a_dim_part_of_a_black_background_widens_the_spread() {
        let table = BackgroundEstimate::estimate(
            &views(|x, y| if x < 10 { [0.06 * noise(x, y); 3] } else { [0.0; 3] }),
            &ball(),
        );
        assert!(
            table.probability([srgb_decode(0.05); 3]) > 0.5 && table.confidence > 0.9,
            "{table:?}"
        );
        assert!(table.probability([srgb_decode(0.25); 3]) < 1e-3, "{table:?}");
    }

    #[test]
    fn a_part_of_another_colour_lowers_the_confidence_only() {
        let two_colours = BackgroundEstimate::estimate(
            &views(|x, _| if x < 10 { [0.8; 3] } else { [0.1; 3] }),
            &ball(),
        );
        assert!(
            two_colours.spread < 0.02 && two_colours.probability([srgb_decode(0.8); 3]) < 1e-6,
            "{two_colours:?}"
        );
        assert!(two_colours.confidence < 1.0, "{two_colours:?}");
    }

    #[test]
    fn clutter_no_views_and_one_pixel_have_a_defined_estimate() {
        let clutter = BackgroundEstimate::estimate(
            &views(|x, y| [noise(x, y), noise(y, x), noise(x + 99, y)]),
            &ball(),
        );
        assert!(clutter.confidence < 0.05, "{clutter:?}");
        let none = BackgroundEstimate::estimate(&[], &ball());
        assert_eq!(none.confidence, 0.0);
        let film = Film::new(1, 1);
        let camera = cameras(1)[0].resized(1, 1);
        let tiny =
            View { name: String::new(), path: Default::default(), camera, image: film, mask: None };
        assert!(BackgroundEstimate::estimate(&[tiny], &ball()).spread >= LEAST_SPREAD);
    }
}
