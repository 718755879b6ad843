//! The faces that are seen at places of lines of the film.

use field::Real;
use glam::DVec2;
use render::{InvalidField, Sample, Scene};

use super::visibility::INSIDE;
use crate::crossing::{Crossing, tolerance};
use crate::record::{FilmLine, Record};

/// The visible surface at one place of a line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place<R: Real> {
    pub(super) s: f64,
    /// The hit of the ray there; `None` for a miss.
    pub(super) hit: Option<FaceHit<R>>,
    /// The normal on the film of the silhouette between this place and the next, of any length;
    /// `None` if there is none.
    pub(super) silhouette: Option<DVec2>,
}

/// A hit with its face.
#[derive(Clone, Copy, Debug)]
pub(super) struct FaceHit<R: Real> {
    /// The number of the face; see [`field::Field::faces`].
    pub(super) face: u32,
    /// The distance along the ray, in world units.
    pub(super) t: R,
    pub(super) x: R::Vec3,
    /// ∇f at the hit.
    pub(super) gradient: R::Vec3,
    pub(super) radiance: R::Vec3,
}

impl<R: Real> Place<R> {
    pub(super) fn new(s: f64, hit: Option<FaceHit<R>>) -> Self {
        Place { s, hit, silhouette: None }
    }

    /// The number of the face; `None` for a miss.
    pub(super) fn face(&self) -> Option<u32> {
        self.hit.map(|hit| hit.face)
    }
}

/// A part of a line with one face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part<'a, R: Real> {
    pub(super) face: u32,
    /// The first and the last place with the face.
    pub(super) ends: [&'a Place<R>; 2],
    /// The place before and the place after these.
    pub(super) around: [Option<&'a Place<R>>; 2],
}

/// Places of every line, in order.
pub(super) struct LinePlaces<R: Real> {
    of_line: Vec<Vec<Place<R>>>,
}

impl<R: Real> LinePlaces<R> {
    /// The ends of all lines, both sides of silhouettes, and one place of each part between these.
    ///
    /// `crossings` are sorted by line, and along each line by s. `inner` has one more place per
    /// line.
    pub(super) fn new(
        scene: &Scene<'_, R>,
        lines: &[FilmLine],
        inner: &[f64],
        crossings: &[Crossing<R>],
        record: &mut Record<R>,
    ) -> Result<Self, InvalidField> {
        let mut next = crossings.iter().peekable();
        // The places, and the normal of the silhouette behind each.
        let (mut wanted, mut behind) = (Vec::new(), Vec::new());
        for (number, inner) in inner.iter().enumerate() {
            let mut from = 0.0;
            let mut segment = |from: f64, to: f64, silhouette: Option<DVec2>| {
                let middle = if (from..to).contains(inner) { *inner } else { (from + to) * 0.5 };
                if to > from {
                    wanted.extend([from, middle, to].map(|s| (number, s)));
                    behind.extend([None, None, silhouette]);
                }
            };
            while let Some(crossing) = next.next_if(|crossing| crossing.line == number) {
                let [before, after] = sides(crossing);
                segment(from, before, Some(film_normal(crossing)));
                from = after;
            }
            segment(from, 1.0, None);
        }
        let mut places = LinePlaces { of_line: vec![Vec::new(); lines.len()] };
        let found = trace(scene, lines, &wanted, record)?;
        for (((line, _), mut place), silhouette) in wanted.iter().zip(found).zip(behind) {
            place.silhouette = silhouette;
            places.of_line[*line].push(place);
        }
        Ok(places)
    }

    /// Pairs of neighbouring places of a line without a silhouette between them.
    pub(super) fn pairs(&self, line: usize) -> impl Iterator<Item = [&Place<R>; 2]> {
        let pairs = self.of_line[line].windows(2).map(|pair| [&pair[0], &pair[1]]);
        pairs.filter(|pair| pair[0].silhouette.is_none())
    }

    /// The number of places of a line.
    pub(super) fn count(&self, line: usize) -> usize {
        self.of_line[line].len()
    }

    /// The neighbouring places with s between them, unless a silhouette lies between them too.
    pub(super) fn around(&self, line: usize, s: f64) -> Option<[&Place<R>; 2]> {
        let places = &self.of_line[line];
        let after = places.partition_point(|place| place.s <= s);
        let before = &places[after.checked_sub(1)?];
        (before.silhouette.is_none()).then_some([before, places.get(after)?])
    }

    /// Adds a place between two without a silhouette between them.
    pub(super) fn insert(&mut self, line: usize, place: Place<R>) {
        let places = &mut self.of_line[line];
        let at = places.partition_point(|other| other.s <= place.s);
        places.insert(at, place);
    }

    /// Notes that the silhouette of a crossing is between the places beside it.
    pub(super) fn note_silhouette(&mut self, crossing: &Crossing<R>) {
        let places = &mut self.of_line[crossing.line];
        let after = places.partition_point(|place| place.s < crossing.s);
        if let Some(before) = after.checked_sub(1) {
            places[before].silhouette = Some(film_normal(crossing));
        }
    }

    /// The parts of a line with one face.
    pub(super) fn parts(&self, line: usize) -> impl Iterator<Item = Part<'_, R>> {
        let places = &self.of_line[line];
        let one = |a: &Place<R>, b: &Place<R>| a.silhouette.is_none() && a.face() == b.face();
        let mut from = 0;
        places.chunk_by(one).filter_map(move |own| {
            let (first, to) = (from, from + own.len());
            from = to;
            let around = [first.checked_sub(1).map(|i| &places[i]), places.get(to)];
            Some(Part { face: own[0].face()?, ends: [&own[0], &own[own.len() - 1]], around })
        })
    }

    /// The place beside a crossing, on the side where its silhouette is seen from inside.
    pub(super) fn inside(&self, crossing: &Crossing<R>) -> Option<&Place<R>> {
        let [before, after] = sides(crossing);
        let s = if crossing.leaves { before } else { after };
        self.of_line[crossing.line].iter().find(|place| place.s == s)
    }
}

/// The normal on the film of the silhouette at a crossing, of any length.
fn film_normal<R: Real>(crossing: &Crossing<R>) -> DVec2 {
    DVec2::from_array(crossing.film_gradient.map(Real::to_double))
}

/// The places on both sides of a crossing with a silhouette.
fn sides<R: Real>(crossing: &Crossing<R>) -> [f64; 2] {
    let aside = INSIDE * tolerance::<R>();
    [crossing.s - aside, crossing.s + aside]
}

/// Traces a ray at every place (line, s).
pub(super) fn trace<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    wanted: &[(usize, f64)],
    record: &mut Record<R>,
) -> Result<Vec<Place<R>>, InvalidField> {
    let samples: Vec<Sample> = wanted.iter().map(|(line, s)| lines[*line].at(*s)).collect();
    let primary = scene.primary(&samples)?;
    record.rays += samples.len() as u64;
    let mut face = vec![0; primary.hits.len()];
    scene.field.faces(&primary.surface.x, &mut face);
    let mut places: Vec<Place<R>> = wanted.iter().map(|(_, s)| Place::new(*s, None)).collect();
    for ((hit, x), face) in primary.hits.iter().zip(&primary.surface.x).zip(face) {
        let radiance = primary.samples[hit.sample].radiance;
        let (t, gradient) = (hit.t, hit.gradient);
        places[hit.sample].hit = Some(FaceHit { face, t, x: *x, gradient, radiance });
    }
    Ok(places)
}
