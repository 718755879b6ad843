//! Depth maps of all photographs.

use field::Sphere;
use film::Film;
use glam::DVec2;
use random::{Name, Stream};
use rayon::prelude::*;
use render::Camera;

use crate::stereo::check::agreed;
use crate::stereo::patch::NEIGHBOURS;
use crate::stereo::photo::Photo;
use crate::stereo::search::{Found, Search};
use crate::stereo::space::Space;

/// The photographs that are compared with a depth.
pub(crate) const COMPARED: usize = 10;

const DEPTH_PLANES: Name = Name::new("planes that the search for depths tries", 30);

/// A photograph with its camera, which must have no radial distortion.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// The camera, in world units.
    pub camera: &'a Camera,
    /// The photograph, linear RGB.
    pub image: &'a Film,
}

/// The distances of the surfaces that the pixels of a photograph show.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// The width in pixels.
    pub width: usize,
    /// The distance along the unit ray through the middle of each pixel, row-major, in world units;
    /// 0 where it is unknown.
    pub distances: Vec<f32>,
}

impl DepthMap {
    /// The distance at a film position, in pixels, if it is known.
    pub fn at(&self, u: DVec2) -> Option<f32> {
        let height = self.distances.len() / self.width;
        let pixel = |place: f64, side: usize| (place as usize).min(side - 1);
        let i = pixel(u.y, height) * self.width + pixel(u.x, self.width);
        Some(self.distances[i]).filter(|distance| *distance > 0.0)
    }

    /// Forgets the distances of pixels (x, y) for which `is_kept` is false.
    pub fn forget_unless(&mut self, is_kept: impl Fn(u32, u32) -> bool) {
        for (i, distance) in self.distances.iter_mut().enumerate() {
            if !is_kept((i % self.width) as u32, (i / self.width) as u32) {
                *distance = 0.0;
            }
        }
    }

    /// The share of the pixels with a known distance.
    pub fn known(&self) -> f64 {
        let count = self.distances.iter().filter(|distance| **distance > 0.0).count();
        count as f64 / self.distances.len().max(1) as f64
    }
}

/// The search for the depth maps of some photographs.
///
/// The same stream gives the same bits on any number of threads.
#[derive(Debug)]
pub struct Stereo {
    pub(crate) photos: Vec<Photo>,
    space: Space,
    stream: Stream,
    /// The planes of the photographs that were searched.
    pub(crate) found: Vec<Vec<Option<Found>>>,
}

impl Stereo {
    /// A search in photographs of a ball, in world units. Only pixels whose rays meet the ball are
    /// searched; the surfaces can be behind it.
    pub fn new(views: &[View<'_>], ball: &Sphere<f64>, stream: Stream) -> Self {
        let ball = Sphere { center: ball.center.as_vec3(), radius: ball.radius as f32 };
        Self::of_space(views, |_| Space::Ball(ball), stream)
    }

    /// A search in photographs of a place that is not known. The cameras alone tell which
    /// photographs to compare, and the distance at which the search begins: a tenth of
    /// the median distance of a camera from the cameras' middle.
    pub fn anywhere(views: &[View<'_>], stream: Stream) -> Self {
        Self::of_space(views, Space::of_cameras, stream)
    }

    fn of_space(views: &[View<'_>], space: impl Fn(&[Photo]) -> Space, stream: Stream) -> Self {
        let photos: Vec<Photo> = views.iter().map(|v| Photo::new(v.camera, v.image)).collect();
        let space = space(&photos);
        Stereo { photos, space, stream: stream.named(DEPTH_PLANES), found: Vec::new() }
    }

    /// The number of photographs that were searched, and that of all.
    pub fn progress(&self) -> (usize, usize) {
        (self.found.len(), self.photos.len())
    }

    /// Searches in the next `count` photographs, in parallel.
    pub fn search(&mut self, count: usize) {
        let (done, all) = self.progress();
        let search = |own: usize| {
            let nearest = self.nearest(own, NEIGHBOURS);
            let neighbours: Vec<&Photo> = nearest.iter().map(|i| &self.photos[*i]).collect();
            let stream = self.stream.at(own as u64);
            Search::run(&self.photos[own], &neighbours, &self.space, stream)
        };
        let next: Vec<_> = (done..(done + count).min(all)).into_par_iter().map(search).collect();
        self.found.extend(next);
    }

    /// The depth maps: of each photograph, the depths with which two others agree. It searches in
    /// the photographs that are left.
    pub fn depth_maps(mut self) -> Vec<DepthMap> {
        self.search(self.photos.len());
        let map = |own: usize| {
            let others = self.nearest(own, COMPARED);
            let distances = agreed(&self.photos, &self.found, own, &others);
            DepthMap { width: self.photos[own].width, distances }
        };
        (0..self.photos.len()).into_par_iter().map(map).collect()
    }

    /// The photographs that are compared with that of `own`, the nearest first.
    pub(crate) fn nearest(&self, own: usize, count: usize) -> Vec<usize> {
        self.space.nearest(&self.photos, own, count)
    }
}
