//! The search for a plane at each pixel.
//!
//! Bleyer, Rhemann and Rother, "PatchMatch Stereo – Stereo Matching with Slanted Support Windows",
//! BMVC 2011: random planes, good ones of which spread to neighbouring pixels, and random changes
//! of decreasing size. Galliani, Lasinger and Schindler, "Massively Parallel Multiview Stereopsis
//! by Surface Normal Diffusion", ICCV 2015: the two colours of a chess board in turn, and the best
//! few of several neighbours.

use glam::{Vec2, Vec3};
use random::Stream;

use crate::stereo::patch::{Patch, Plane, WORST, pattern};
use crate::stereo::photo::Photo;
use crate::stereo::space::Space;

/// Random planes of a pixel at the start.
const FIRST_PLANES: u64 = 3;

/// Passes over all pixels.
const PASSES: u64 = 4;

/// Pixels whose planes a pixel tries: near ones in each pass, far ones in the first passes.
const NEAR: [[isize; 2]; 4] = [[-1, 0], [1, 0], [0, -1], [0, 1]];
const FAR: [[isize; 2]; 4] = [[-5, 0], [5, 0], [0, -5], [0, 5]];

/// Passes in which far pixels are tried.
const FAR_PASSES: u64 = 2;

/// The least cosine between a plane's normal and the direction towards the camera.
const LEAST_COSINE: f32 = 0.1;

/// The plane of a pixel, and its cost.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found {
    pub(crate) plane: Plane,
    pub(crate) cost: f32,
}

/// The search in one photograph.
pub(crate) struct Search<'a> {
    photo: &'a Photo,
    neighbours: &'a [&'a Photo],
    stream: Stream,
    /// The range of inverse depths of each pixel that is searched.
    ranges: Vec<Option<[f32; 2]>>,
    found: Vec<Option<Found>>,
}

impl<'a> Search<'a> {
    /// The planes of a photograph's pixels, row-major: those whose rays meet the space, and whose
    /// patches have a pattern in two directions. The depth of a plane can be behind it.
    pub(crate) fn run(
        photo: &'a Photo,
        neighbours: &'a [&'a Photo],
        space: &Space,
        stream: Stream,
    ) -> Vec<Option<Found>> {
        let (width, height) = (photo.width, photo.height);
        let range = |x, y| {
            let found = space.inverse_depths(photo, photo.ray(middle(x, y)))?;
            pattern(photo, x, y).filter(|pattern| !pattern.is_ambiguous()).map(|_| found)
        };
        let ranges = (0..width * height).map(|i| range(i % width, i / width)).collect();
        let found = vec![None; width * height];
        let mut search = Search { photo, neighbours, stream, ranges, found };
        search.visit_all(|_| true, |search, x, y| search.start(x, y));
        for pass in 0..PASSES {
            for color in 0..2 {
                let is_of = |sum| sum % 2 == color;
                search.visit_all(is_of, |search, x, y| search.improve(pass, x, y));
            }
        }
        search.found
    }

    /// Replaces the planes of all pixels whose sum of coordinates is wanted.
    fn visit_all(
        &mut self,
        is_wanted: impl Fn(usize) -> bool,
        visit: impl Fn(&Self, usize, usize) -> Option<Found>,
    ) {
        for y in 0..self.photo.height {
            for x in (0..self.photo.width).filter(|x| is_wanted(x + y)) {
                let i = self.photo.index(x, y);
                if self.ranges[i].is_some() {
                    self.found[i] = visit(self, x, y);
                }
            }
        }
    }

    /// A stream of random numbers for a pixel and a pass.
    fn stream(&self, pass: u64, x: usize, y: usize) -> Stream {
        self.stream.at(pass).at(self.photo.index(x, y) as u64)
    }

    /// The best of some random planes.
    fn start(&self, x: usize, y: usize) -> Option<Found> {
        let patch = Patch::of(self.photo, x, y)?;
        let [low, high] = self.ranges[self.photo.index(x, y)]?;
        let ray = self.photo.ray(middle(x, y));
        let stream = self.stream(PASSES, x, y);
        let mut best: Option<Found> = None;
        for k in 0..FIRST_PLANES {
            let stream = stream.at(k);
            let part = stream.at(0).unit() as f32;
            // The last one is behind the space.
            let inverse = if k + 1 < FIRST_PLANES { low + (high - low) * part } else { low * part };
            let normal = facing(direction(stream.at(1)) - ray.normalize(), ray);
            let plane = Plane { depth: inverse.max(f32::MIN_POSITIVE).recip(), normal };
            self.try_plane(&patch, plane, &mut best);
        }
        best
    }

    /// The best of a pixel's plane, those of its neighbours, and random changes of the best.
    fn improve(&self, pass: u64, x: usize, y: usize) -> Option<Found> {
        let i = self.photo.index(x, y);
        let mut best = self.found[i];
        let patch = Patch::of(self.photo, x, y)?;
        let [low, high] = self.ranges[i]?;
        let ray = self.photo.ray(middle(x, y));
        let far: &[[isize; 2]] = if pass < FAR_PASSES { &FAR } else { &[] };
        for [dx, dy] in NEAR.iter().chain(far).copied() {
            let (x, y) = (x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
            if x >= self.photo.width || y >= self.photo.height {
                continue;
            }
            if let Some(other) = self.found[self.photo.index(x, y)] {
                let ray_there = self.photo.ray(middle(x, y));
                let depth = other.plane.depth_at(ray_there, ray);
                self.try_plane(&patch, Plane { depth, ..other.plane }, &mut best);
            }
        }
        let size = 0.5f32.powi(pass as i32);
        let stream = self.stream(pass, x, y);
        // A change of the depth and the normal, and one that is smaller.
        for (k, part) in [(0, 0.25), (1, 0.03)] {
            let Some(Found { plane, .. }) = best else { continue };
            let stream = stream.at(k);
            let change = (2.0 * stream.at(0).unit() as f32 - 1.0) * part * size * (high - low);
            let inverse = (plane.depth.recip() + change).clamp(1e-3 * low, high);
            let turn = direction(stream.at(1)) * (if k == 0 { 0.6 } else { 0.2 } * size);
            let normal = facing(plane.normal + turn, ray);
            self.try_plane(&patch, Plane { depth: inverse.recip(), normal }, &mut best);
        }
        best
    }

    /// Takes a plane if it is better.
    fn try_plane(&self, patch: &Patch, plane: Plane, best: &mut Option<Found>) {
        if !(plane.depth > 0.0 && plane.depth.is_finite()) {
            return;
        }
        let cost = patch.cost(self.photo, self.neighbours, &plane);
        if cost < best.map_or(WORST, |best| best.cost) {
            *best = Some(Found { plane, cost });
        }
    }
}

/// The film position of a pixel's middle.
pub(crate) fn middle(x: usize, y: usize) -> Vec2 {
    Vec2::new(x as f32 + 0.5, y as f32 + 0.5)
}

/// A random vector in the unit ball.
fn direction(stream: Stream) -> Vec3 {
    Vec3::from(stream.in_ball().map(|c| c as f32))
}

/// The unit vector along `normal`, turned until it faces the camera of a ray.
fn facing(normal: Vec3, ray: Vec3) -> Vec3 {
    let view = -ray.normalize();
    let normal = normal.normalize_or(view);
    let cosine = normal.dot(view);
    let lacking = (LEAST_COSINE - cosine).max(0.0);
    (normal + view * lacking).normalize_or(view)
}
