//! Points on the surfaces that photographs show, from matches between them.

use dataset::View;
use film::Film;
use glam::{DVec2, DVec3};
use multiview::stereo::{self, Stereo};
use random::Stream;
use rayon::prelude::*;
use render::Camera;

/// The most pixels of a photograph that are searched: about 190 × 140.
const MOST_PIXELS: u32 = 1 << 13;

/// The most photographs that are searched, spread over all of them.
const MOST_VIEWS: usize = 32;

/// The half of the middle of a film, in parts of its sides.
const HALF_MIDDLE: f64 = 0.25;

/// The least share of the pixels of the middle of a film with a known depth.
const LEAST_KNOWN: f64 = 0.05;

/// The seed of the search: photographs alone decide the sphere.
const SEED: u64 = 0;

/// A photograph as the search reads it.
struct Small {
    camera: Camera,
    image: Film,
    /// The factor between the sides.
    factor: u32,
}

impl Small {
    fn of(view: &View, origin: DVec3, unit: f64) -> Self {
        let pixels = |n: u32| view.image.width.div_ceil(n) * view.image.height.div_ceil(n);
        let factor = (1..).find(|n| pixels(*n) <= MOST_PIXELS).unwrap_or(1);
        let image = view.image.downscaled(factor);
        let camera = view.camera.about(origin).reduced(factor, image.width, image.height);
        Small { camera: Camera { eye: camera.eye / unit, ..camera }, image, factor }
    }

    /// Whether a pixel is in the middle of the film.
    fn is_middle(&self, u: DVec2) -> bool {
        let size = DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        (u / size - 0.5).abs().max_element() < HALF_MIDDLE
    }
}

/// What matches between photographs show, in the units of the data set.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Matches {
    /// Points on surfaces: three photographs agree about each.
    pub(crate) points: Vec<DVec3>,
    /// For the photographs whose middle is known: its number, and the median depth
    /// along the optical axis.
    pub(crate) depths: Vec<(usize, f64)>,
}

impl Matches {
    /// Searches in photographs, of which no place is known. Nothing is found if all stand at one
    /// place.
    pub(crate) fn of(views: &[View]) -> Self {
        let step = views.len().div_ceil(MOST_VIEWS);
        let chosen: Vec<usize> = (0..views.len()).step_by(step).collect();
        let eyes = || chosen.iter().map(|i| views[*i].camera.eye);
        let origin = eyes().sum::<DVec3>() / chosen.len() as f64;
        let unit = eyes().map(|eye| eye.distance(origin)).fold(0.0, f64::max);
        if !(unit > 0.0 && unit.is_finite()) {
            return Matches::default();
        }
        let small: Vec<Small> =
            chosen.par_iter().map(|i| Small::of(&views[*i], origin, unit)).collect();
        let stereo_views: Vec<stereo::View<'_>> =
            small.iter().map(|s| stereo::View { camera: &s.camera, image: &s.image }).collect();
        let maps = Stereo::anywhere(&stereo_views, Stream::of_seed(SEED)).depth_maps();
        let mut matches = Matches::default();
        for ((own, small), map) in chosen.into_iter().zip(&small).zip(&maps) {
            let (mut depths, mut all) = (Vec::new(), 0);
            for (i, distance) in map.distances.iter().enumerate() {
                let [x, y] = [i % map.width, i / map.width];
                let u = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let is_middle = small.is_middle(u);
                all += usize::from(is_middle);
                let [x, y] = [x, y].map(|p| p * small.factor as usize);
                if *distance == 0.0 || !views[own].is_used(y * views[own].image.width as usize + x)
                {
                    continue;
                }
                let along = small.camera.direction(u) * f64::from(*distance) * unit;
                matches.points.push(views[own].camera.eye + along);
                if is_middle {
                    depths.push(along.dot(small.camera.forward));
                }
            }
            if depths.len() as f64 >= LEAST_KNOWN * all as f64 {
                depths.sort_by(f64::total_cmp);
                matches.depths.push((own, depths[depths.len() / 2]));
            }
        }
        matches
    }
}
