//! Points on the surfaces that photographs show, from matches between them.

use dataset::View;
use glam::{DVec2, DVec3};
use multiview::stereo::{DepthMap, Stereo, View as Photograph};
use random::Stream;
use rayon::prelude::*;
use render::Camera;

use crate::aim::{Depths, central_ray};

/// The most pixels of a photograph that are searched: about 104 × 78.
const MOST_PIXELS: u64 = 1 << 13;

/// The most photographs that are searched, spread over all of them.
const MOST_VIEWS: usize = 32;

/// The half of the middle of a film, in parts of its sides.
const HALF_MIDDLE: f64 = 0.25;

/// The least share of the pixels of the middle of a film with a known depth.
const LEAST_KNOWN: f64 = 0.05;

/// The seed of the search: photographs alone decide the sphere.
const SEED: u64 = 0;

/// What matches between photographs show, in the units of the data set.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Matches {
    /// Points on surfaces: three photographs agree about each.
    pub(crate) points: Vec<DVec3>,
    /// The median depths in the middle of the photographs where they are known.
    pub(crate) depths: Depths,
}

impl Matches {
    /// Searches in photographs, of which no place is known. Nothing is found if all stand at one
    /// place.
    pub(crate) fn of(views: &[View]) -> Self {
        let step = views.len().div_ceil(MOST_VIEWS).max(1);
        let chosen: Vec<usize> = (0..views.len()).step_by(step).collect();
        let eyes = || chosen.iter().map(|i| views[*i].camera.eye);
        let origin = eyes().sum::<DVec3>() / chosen.len().max(1) as f64;
        let unit = eyes().map(|eye| eye.distance(origin)).fold(0.0, f64::max);
        if !(unit > 0.0 && unit.is_finite()) {
            return Matches::default();
        }
        let small: Vec<View> = chosen.par_iter().map(|i| reduced(&views[*i])).collect();
        let of_search = |view: &View| {
            let camera = view.camera.about(origin);
            Camera { eye: camera.eye / unit, ..camera }
        };
        let cameras: Vec<Camera> = small.iter().map(of_search).collect();
        let photographs = cameras.iter().zip(&small);
        let photographs: Vec<Photograph<'_>> =
            photographs.map(|(camera, view)| Photograph { camera, image: &view.image }).collect();
        let maps = Stereo::anywhere(&photographs, Stream::of_seed(SEED)).depth_maps();

        let mut matches = Matches::default();
        matches.depths.searched = chosen.len();
        for ((own, view), map) in chosen.into_iter().zip(&small).zip(&maps) {
            if let Some(depth) = matches.add(view, map, unit) {
                matches.depths.of_views.push((own, depth));
            }
        }
        matches
    }

    /// Adds the points of a photograph, whose distances have this unit. Returns the median distance
    /// along the ray through the middle of the film, if enough are known around it.
    fn add(&mut self, view: &View, map: &DepthMap, unit: f64) -> Option<f64> {
        let size = DVec2::new(f64::from(view.image.width), f64::from(view.image.height));
        let (mut depths, mut all) = (Vec::new(), 0usize);
        for (i, distance) in map.distances.iter().enumerate() {
            let u = DVec2::new((i % map.width) as f64 + 0.5, (i / map.width) as f64 + 0.5);
            let is_middle = (u / size - 0.5).abs().max_element() < HALF_MIDDLE;
            all += usize::from(is_middle);
            if *distance == 0.0 || !view.is_used(i) {
                continue;
            }
            let along = view.camera.direction(u) * f64::from(*distance) * unit;
            self.points.push(view.camera.eye + along);
            if is_middle {
                depths.push(along.dot(central_ray(view)));
            }
        }
        depths.sort_by(f64::total_cmp);
        let median = depths.get(depths.len() / 2).copied();
        median.filter(|_| depths.len() as f64 >= LEAST_KNOWN * all as f64)
    }
}

/// The view at the size at which it is searched.
fn reduced(view: &View) -> View {
    let pixels =
        |n: u32| u64::from(view.image.width.div_ceil(n)) * u64::from(view.image.height.div_ceil(n));
    view.downscaled((1..=u32::MAX).find(|n| pixels(*n) <= MOST_PIXELS).unwrap_or(1))
}
