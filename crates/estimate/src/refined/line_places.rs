//! The faces that are seen at places of lines of the film.

use field::Real;
use render::{InvalidField, Sample, Scene};

use super::visibility::INSIDE;
use crate::film_line::{Crossing, FilmLine, tolerance};
use record::Record;

/// The visible surface at one place of a line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place<R: Real> {
    pub(super) s: f64,
    /// The hit of the ray there; `None` for a miss.
    pub(super) hit: Option<FaceHit<R>>,
    /// Whether a silhouette lies between this place and the next.
    before_silhouette: bool,
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
        Place { s, hit, before_silhouette: false }
    }
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
        // The places, and whether each is the last before a silhouette.
        let (mut wanted, mut last) = (Vec::new(), Vec::new());
        for (number, inner) in inner.iter().enumerate() {
            let mut from = 0.0;
            let mut segment = |from: f64, to: f64, silhouette: bool| {
                let middle = if (from..to).contains(inner) { *inner } else { (from + to) * 0.5 };
                if to > from {
                    wanted.extend([from, middle, to].map(|s| (number, s)));
                    last.extend([false, false, silhouette]);
                }
            };
            while let Some(crossing) = next.next_if(|crossing| crossing.line == number) {
                let [before, after] = sides(crossing);
                segment(from, before, true);
                from = after;
            }
            segment(from, 1.0, false);
        }
        let mut places = LinePlaces { of_line: vec![Vec::new(); lines.len()] };
        let found = trace(scene, lines, &wanted, record)?;
        for (((line, _), mut place), before_silhouette) in wanted.iter().zip(found).zip(last) {
            place.before_silhouette = before_silhouette;
            places.of_line[*line].push(place);
        }
        Ok(places)
    }

    /// Pairs of neighbouring places of a line without a silhouette between them.
    pub(super) fn pairs(&self, line: usize) -> impl Iterator<Item = [&Place<R>; 2]> {
        let pairs = self.of_line[line].windows(2).map(|pair| [&pair[0], &pair[1]]);
        pairs.filter(|pair| !pair[0].before_silhouette)
    }

    /// The place beside a crossing, on the side where its silhouette is seen from inside.
    pub(super) fn inside(&self, crossing: &Crossing<R>) -> Option<&Place<R>> {
        let [before, after] = sides(crossing);
        let s = if crossing.leaves { before } else { after };
        self.of_line[crossing.line].iter().find(|place| place.s == s)
    }
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
