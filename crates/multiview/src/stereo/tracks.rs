//! Places of the same points in several photographs.

use glam::{DVec2, Vec2};
use rayon::prelude::*;

use crate::stereo::align::{Parallelogram, align};
use crate::stereo::check::LARGEST_COST;
use crate::stereo::depth::{COMPARED, Stereo};
use crate::stereo::patch::pattern;
use crate::stereo::search::{Found, middle};

/// The side of the cells of a photograph, in pixels; each gives one track at most.
const CELL: usize = 8;

/// The largest distance, in pixels, between a place and itself, on the way through another
/// photograph and back.
const BACK: f32 = 0.15;

/// The places of a track, at least: two have a residual across the ray of each other.
const MIN_TRACK_LENGTH: usize = 2;

/// The places of one point: for each photograph that shows it, its number and the film position, in
/// pixels.
pub type Places = Vec<(usize, DVec2)>;

impl Stereo {
    /// The places of points with a pattern around them. The planes that the search found predict
    /// where other photographs show them, and the photographs are aligned there. So the places do
    /// not depend on the cameras. It searches in the photographs that are left.
    ///
    /// The error of a place is about a twentieth of a pixel.
    pub fn tracks(&mut self) -> Vec<Places> {
        self.search(self.photos.len());
        let all = (0..self.photos.len()).into_par_iter().map(|own| self.tracks_of(own));
        all.collect::<Vec<_>>().concat()
    }

    /// The tracks that begin in the photograph `own`.
    fn tracks_of(&self, own: usize) -> Vec<Places> {
        let photo = &self.photos[own];
        let others = self.nearest(own, COMPARED);
        let track = |[x, y]: [usize; 2]| {
            let found = self.found[own][photo.index(x, y)]?;
            let seen = |other: &usize| Some((*other, self.place(own, [x, y], &found, *other)?));
            let own = (own, middle(x, y).as_dvec2());
            let places: Places =
                std::iter::once(own).chain(others.iter().filter_map(seen)).collect();
            (places.len() >= MIN_TRACK_LENGTH).then_some(places)
        };
        let rows = (0..photo.height).step_by(CELL);
        let cells = rows.flat_map(|y| (0..photo.width).step_by(CELL).map(move |x| [x, y]));
        cells.filter_map(|cell| self.corner(own, cell)).filter_map(track).collect()
    }

    /// The pixel of a cell with a plane and the strongest pattern.
    fn corner(&self, own: usize, [left, top]: [usize; 2]) -> Option<[usize; 2]> {
        let photo = &self.photos[own];
        let mut best = (0.0, None);
        for y in top..(top + CELL).min(photo.height) {
            for x in left..(left + CELL).min(photo.width) {
                let found = self.found[own][photo.index(x, y)];
                if !found.is_some_and(|found| found.cost < LARGEST_COST) {
                    continue;
                }
                let strength = pattern(photo, x, y).map_or(0.0, |pattern| pattern.across());
                if strength > best.0 {
                    best = (strength, Some([x, y]));
                }
            }
        }
        best.1
    }

    /// The place of a pixel's point in another photograph.
    fn place(&self, own: usize, [x, y]: [usize; 2], found: &Found, other: usize) -> Option<DVec2> {
        let (photo, there) = (&self.photos[own], &self.photos[other]);
        let at = middle(x, y);
        let image = |u: Vec2| {
            let ray = photo.ray(u);
            there.project(photo.eye + ray * found.plane.depth_at(photo.ray(at), ray))
        };
        let expected = image(at)?;
        let (right, below) = (image(at + Vec2::X)? - expected, image(at + Vec2::Y)? - expected);
        let start = Parallelogram { middle: expected, right, below };
        let aligned = align(photo, at, there, start)?;
        let back = align(there, aligned.middle, photo, aligned.inverse(at)?)?;
        (back.middle.distance(at) < BACK).then(|| aligned.middle.as_dvec2())
    }
}
