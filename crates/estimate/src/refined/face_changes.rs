//! Places on lines of the film where the visible surface goes from one face to another.

use field::Real;
use render::{InvalidField, Scene};
use rustc_hash::FxHashMap;

use super::creases::is_crease;
use super::crossings::crossings_at;
use super::face_change::FaceChange;
use super::line_places::{FaceHit, LinePlaces, Place, trace};
use super::neighbours::Neighbours;
use super::unseen_faces::unseen_faces;
use crate::crossing::{Crossing, Rim, tolerance};
use crate::record::{FilmLine, Record};

/// The places where lines go from face to face.
pub(super) struct FaceChanges<R: Real> {
    /// Where the faces meet. Each is two tolerances wide.
    pub(super) creases: Vec<FaceChange<R>>,
    /// Where one hides the other: silhouettes that were not known.
    pub(super) crossings: Vec<Crossing<R>>,
}

/// The largest number of rounds. Each round divides an interval in two or three parts; every second
/// one halves it.
const ROUNDS: u32 = 28;

/// The largest number of intervals per line, for fields that have a new face everywhere.
const MAX_INTERVALS: usize = 16;

/// Finds the places where lines go from face to face between known silhouettes.
///
/// A line that passes through a narrow face between two places of [`LinePlaces::new`] gets a place
/// there if a line beside it has met the face. A face that lies between all places of all lines of
/// its pixel is missed.
///
/// `crossings` are sorted by line, and along each line by s. `inner` has one more place per line.
pub(super) fn face_changes<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    inner: &[f64],
    crossings: &[Crossing<R>],
    record: &mut Record<R>,
) -> Result<FaceChanges<R>, InvalidField> {
    let mut places = LinePlaces::new(scene, lines, inner, crossings, record)?;
    let neighbours = Neighbours::new(lines);
    let mut out = FaceChanges { creases: vec![], crossings: vec![] };
    let mut rims = at_rims(scene, crossings, &places);
    let mut fresh: Vec<usize> = (0..lines.len()).collect();
    while !fresh.is_empty() {
        let open = fresh.iter().flat_map(|line| changes(&places, *line)).collect();
        let mut narrow = narrowed(scene, lines, open, record)?;
        fresh.extend(narrow.iter().map(|change| change.line));
        for change in &narrow {
            for (s, hit) in change.ends {
                places.insert(change.line, Place::new(s, Some(hit)));
            }
        }
        narrow.append(&mut rims);
        let (creases, silhouettes): (Vec<_>, Vec<_>) =
            narrow.into_iter().partition(|change| is_crease(scene, lines, change));
        out.creases.extend(creases);
        let found = crossings_at(scene, lines, &silhouettes, crossings)?;
        record.rays += found.rays;
        found.crossings.iter().for_each(|crossing| places.note_silhouette(crossing));
        out.crossings.extend(found.crossings);
        sort_unique(&mut fresh);
        let wanted = unseen_faces(scene, lines, &neighbours, &places, &fresh);
        fresh.clear();
        for (place, (line, _)) in trace(scene, lines, &wanted, record)?.into_iter().zip(wanted) {
            places.insert(line, place);
            fresh.push(line);
        }
        sort_unique(&mut fresh);
    }
    Ok(out)
}

fn sort_unique(lines: &mut Vec<usize>) {
    lines.sort_unstable();
    lines.dedup();
}

/// The width of a change whose place is known, in pixels.
fn narrow<R: Real>() -> f64 {
    2.02 * tolerance::<R>()
}

/// The changes of a line whose place is not yet known.
fn changes<R: Real>(places: &LinePlaces<R>, line: usize) -> impl Iterator<Item = FaceChange<R>> {
    let change = move |[a, b]: [&Place<R>; 2]| FaceChange::between(line, a, b);
    places.pairs(line).filter_map(change).filter(|change| change.width() > narrow::<R>())
}

/// Changes divided until their places are known.
fn narrowed<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    mut open: Vec<FaceChange<R>>,
    record: &mut Record<R>,
) -> Result<Vec<FaceChange<R>>, InvalidField> {
    let mut found = Vec::new();
    for round in 0..ROUNDS {
        if open.is_empty() {
            break;
        }
        let parts = divided(scene, lines, &open, round % 2 == 0, record)?;
        let (known, rest) = parts.into_iter().partition(|part| part.width() <= narrow::<R>());
        found.extend::<Vec<_>>(known);
        open = rest;
    }
    Ok(found)
}

/// The changes between smooth silhouettes and the places beside them, inside the solid.
///
/// A face that is narrower than that between its silhouette and another face is in no ray. Where
/// the two curves meet, they have a common tangent, so this is a large part of their last pixel.
fn at_rims<R: Real>(
    scene: &Scene<'_, R>,
    crossings: &[Crossing<R>],
    places: &LinePlaces<R>,
) -> Vec<FaceChange<R>> {
    let smooth: Vec<&Crossing<R>> =
        crossings.iter().filter(|crossing| !crossing.rim.edge).collect();
    let x: Vec<R::Vec3> = smooth.iter().map(|crossing| crossing.rim.x).collect();
    let mut face = vec![0; x.len()];
    scene.field.faces(&x, &mut face);
    let change = |(crossing, face): (&&Crossing<R>, u32)| {
        let place = places.inside(crossing)?;
        let Rim { t, x, gradient, radiance, .. } = crossing.rim;
        let rim = Place::new(crossing.s, Some(FaceHit { face, t, x, gradient, radiance }));
        let [a, b] = if crossing.leaves { [place, &rim] } else { [&rim, place] };
        FaceChange::between(crossing.line, a, b)
    };
    smooth.iter().zip(face).filter_map(change).collect()
}

/// The parts of intervals that have a change: around the expected place, or halves.
fn divided<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    open: &[FaceChange<R>],
    expected: bool,
    record: &mut Record<R>,
) -> Result<Vec<FaceChange<R>>, InvalidField> {
    let reach = tolerance::<R>();
    let wanted: Vec<(usize, f64)> = open
        .iter()
        .flat_map(|interval| {
            let [from, to] = interval.ends.map(|(s, _)| s);
            let at = if expected { interval.expected(scene, lines) } else { (from + to) * 0.5 };
            [(at - reach).max(from), (at + reach).min(to)].map(|s| (interval.line, s))
        })
        .collect();
    let places = trace(scene, lines, &wanted, record)?;
    let mut of_line = FxHashMap::default();
    let mut parts = Vec::new();
    for (interval, inner) in open.iter().zip(places.chunks_exact(2)) {
        let [first, last] = interval.ends.map(|(s, hit)| Place::new(s, Some(hit)));
        for pair in [[&first, &inner[0]], [&inner[0], &inner[1]], [&inner[1], &last]] {
            let part = FaceChange::between(interval.line, pair[0], pair[1]);
            let parts_of_line = of_line.entry(interval.line).or_insert(0);
            if let Some(part) = part.filter(|_| *parts_of_line < MAX_INTERVALS) {
                *parts_of_line += 1;
                parts.push(part);
            }
        }
    }
    Ok(parts)
}
