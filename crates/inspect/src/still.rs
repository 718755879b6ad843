//! Whether the backdrop stands still in the image while the cameras move: an object that turns in
//! front of a fixed camera, with poses relative to the object.

use field::Sphere;
use film::srgb_encode;
use glam::DMat3;
use rayon::prelude::*;

use crate::background::{LEAST_SPREAD, deviation, median, reach, surrounding_places};
use dataset::View;

/// The least number of views.
const LEAST_VIEWS: usize = 5;

/// The median angle between the poses of two cameras from which on they move, degrees. The backdrop
/// of a real room, however far away, then moves in the image, too.
const LEAST_TURN: f64 = 10.0;

/// The least number of places on the film that are compared.
const LEAST_PLACES: usize = 64;

/// The largest spread of the pixels of a place over the views, in display units: JPEG files and
/// sensors in dim light have 0.01 to 0.02.
const MOST_SPREAD: f32 = 0.04;

/// The quantile of the views by which all are judged: a few may show something else.
const WORST: f64 = 0.2;

/// The share that must stand still by the film's place beyond what stands still at any place, as
/// part of the rest: a plain backdrop has the same colour everywhere.
const LEAST_PATTERN: f64 = 0.3;

/// The least radiance, linear, by which exposures are compared.
const LEAST_RADIANCE: f32 = 0.02;

/// The backdrop of photographs, as far as it stands still in the image.
#[derive(Clone, Debug, PartialEq)]
pub struct Still {
    /// The share of the pixels around the sphere, 0 to 1, that show the same at their place on the
    /// film in all views: that of a bad view, which four of five exceed.
    pub share: f32,
    /// The standard deviation of such a pixel over the views, in display units.
    pub spread: f32,
    /// The factor of each channel by which each view shows the backdrop. The mean logarithm over
    /// the views is 0.
    pub gains: Vec<[f32; 3]>,
}

/// The least share that counts as standing still.
const STILL: f32 = 0.85;

impl Still {
    /// No backdrop that stands still.
    pub const NONE: Self = Still { share: 0.0, spread: LEAST_SPREAD, gains: Vec::new() };

    /// Compares the pixels whose rays miss the sphere, and those of the border, with those at the
    /// same place of the other views. The share is 0 if the views have several sizes, are fewer
    /// than 5, hardly turn around the sphere, or show a plain backdrop.
    pub fn of(views: &[View], sphere: &Sphere<f64>) -> Self {
        if views.len() < LEAST_VIEWS || !have_one_size(views) || turn(views) < LEAST_TURN {
            return Still::NONE;
        }
        Self::between(views, sphere).unwrap_or(Still::NONE)
    }

    /// Whether the backdrop stands still.
    pub fn is_still(&self) -> bool {
        self.share >= STILL
    }

    /// The spread of the exposures by the backdrop: a standard deviation, in stops.
    pub fn stops(&self) -> f64 {
        let stops = |gain: &[f32; 3]| f64::from(gain.iter().map(|g| g.log2()).sum::<f32>() / 3.0);
        let square = |gain| stops(gain).powi(2);
        (self.gains.iter().map(square).sum::<f64>() / self.gains.len().max(1) as f64).sqrt()
    }

    /// As [`of`](Self::of), for views of one size.
    fn between(views: &[View], sphere: &Sphere<f64>) -> Option<Self> {
        let places = Place::shared(views, sphere);
        if places.len() < LEAST_PLACES {
            return None;
        }
        let mut gains = vec![[1.0; 3]; views.len()];
        for _ in 0..2 {
            let colors: Vec<[f32; 3]> = places.iter().map(|place| place.color(&gains)).collect();
            gains = gains_of(&places, &colors, views.len());
        }
        let colors: Vec<[f32; 3]> = places.iter().map(|place| place.color(&gains)).collect();
        // The difference of each sample from a colour, in display units.
        let differences = |colors: &[[f32; 3]]| {
            let of_place = |(place, color): (&Place, &[f32; 3])| {
                let shown = color.map(srgb_encode);
                let sample = |(view, rgb): &(usize, [f32; 3])| {
                    let own = without(*rgb, gains[*view]).map(srgb_encode);
                    (*view, [0, 1, 2].map(|c| own[c] - shown[c]))
                };
                place.samples.iter().map(sample).collect::<Vec<_>>()
            };
            places.par_iter().zip(colors).flat_map_iter(of_place).collect::<Vec<_>>()
        };
        let own = differences(&colors);
        let residuals: Vec<[f32; 3]> = own.iter().map(|(_, rgb)| *rgb).collect();
        let spread = deviation(&residuals, [0.0; 3]);
        if spread > MOST_SPREAD {
            return None;
        }
        let mut elsewhere = colors;
        elsewhere.rotate_left(places.len() / 3);
        let [share, chance] = [own, differences(&elsewhere)]
            .map(|differences| share_of_views(&differences, views.len(), reach(spread)));
        let has_pattern = share - chance > LEAST_PATTERN * (1.0 - chance);
        Some(Still { share: if has_pattern { share as f32 } else { 0.0 }, spread, gains })
    }
}

/// Whether all views have the same size.
pub(crate) fn have_one_size(views: &[View]) -> bool {
    let size = |view: &View| [view.image.width, view.image.height];
    views.windows(2).all(|pair| size(&pair[0]) == size(&pair[1]))
}

/// The median angle between the poses of two cameras, degrees.
fn turn(views: &[View]) -> f64 {
    let pose = |view: &View| {
        let camera = &view.camera;
        DMat3::from_cols(camera.right, camera.up, camera.forward)
    };
    let poses: Vec<DMat3> = views.iter().map(pose).collect();
    let angle = |a: &DMat3, b: &DMat3| {
        let relative = a.transpose() * *b;
        let trace = relative.x_axis.x + relative.y_axis.y + relative.z_axis.z;
        (0.5 * (trace - 1.0)).clamp(-1.0, 1.0).acos().to_degrees()
    };
    let pairs = (0..poses.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    let mut angles: Vec<f64> = pairs.map(|(i, j)| angle(&poses[i], &poses[j])).collect();
    angles.sort_by(f64::total_cmp);
    angles[angles.len() / 2]
}

/// A place on the film with what the views show there.
struct Place {
    /// Numbers of views, and linear RGB.
    samples: Vec<(usize, [f32; 3])>,
}

impl Place {
    /// The places around the sphere that at least half of the views show, as far as masks do not
    /// leave them out.
    fn shared(views: &[View], sphere: &Sphere<f64>) -> Vec<Place> {
        let width = views[0].image.width as usize;
        let of_view = |(number, view): (usize, &View)| {
            let mut places: Vec<usize> = surrounding_places(view, sphere)
                .into_iter()
                .map(|(x, y)| y as usize * width + x as usize)
                .filter(|i| view.is_used(*i))
                .collect();
            places.sort_unstable();
            places.dedup();
            places.into_iter().map(|i| (i, number, view.image.pixels[i])).collect::<Vec<_>>()
        };
        let mut all: Vec<(usize, usize, [f32; 3])> =
            views.par_iter().enumerate().flat_map_iter(of_view).collect();
        all.sort_by_key(|(place, view, _)| (*place, *view));
        let places = all.chunk_by(|a, b| a.0 == b.0).filter(|own| 2 * own.len() >= views.len());
        let place = |own: &[(usize, usize, [f32; 3])]| Place {
            samples: own.iter().map(|(_, view, rgb)| (*view, *rgb)).collect(),
        };
        places.map(place).collect()
    }

    /// The median colour, linear RGB, of the samples without the gains of their views.
    fn color(&self, gains: &[[f32; 3]]) -> [f32; 3] {
        let channel = |c: usize| {
            let own = self.samples.iter().map(|(view, rgb)| rgb[c] / gains[*view][c]);
            median(own.collect())
        };
        [0, 1, 2].map(channel)
    }
}

/// Linear RGB without a gain.
pub(crate) fn without(rgb: [f32; 3], gain: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|c| rgb[c] / gain[c])
}

/// The gains of the views: medians of the ratios to the colours of the places.
fn gains_of(places: &[Place], colors: &[[f32; 3]], views: usize) -> Vec<[f32; 3]> {
    let mut gains = vec![[1.0; 3]; views];
    for c in 0..3 {
        let mut ratios: Vec<Vec<f32>> = vec![Vec::new(); views];
        for (place, color) in
            places.iter().zip(colors).filter(|(_, color)| color[c] > LEAST_RADIANCE)
        {
            place.samples.iter().for_each(|(view, rgb)| ratios[*view].push(rgb[c] / color[c]));
        }
        let own = ratios.into_iter().map(|own| if own.is_empty() { 1.0 } else { median(own) });
        let own: Vec<f32> = own.map(|gain| gain.clamp(0.1, 10.0)).collect();
        let mean = (own.iter().map(|gain| gain.ln()).sum::<f32>() / views as f32).exp();
        gains.iter_mut().zip(own).for_each(|(gain, own)| gain[c] = own / mean);
    }
    gains
}

/// The share of the differences of a view that are less than `reach` in all channels, of a view
/// that is worse than most.
fn share_of_views(differences: &[(usize, [f32; 3])], views: usize, reach: f32) -> f64 {
    let mut counts = vec![(0, 0); views];
    for (view, rgb) in differences {
        counts[*view].0 += usize::from(rgb.iter().all(|v| v.abs() < reach));
        counts[*view].1 += 1;
    }
    let share = |(near, all): (usize, usize)| near as f64 / all.max(1) as f64;
    let mut shares: Vec<f64> = counts.into_iter().map(share).collect();
    shares.sort_by(f64::total_cmp);
    shares[(WORST * views as f64) as usize]
}
