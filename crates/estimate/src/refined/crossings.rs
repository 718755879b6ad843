//! The crossings of lines on the film with visible silhouettes.

use field::Real;
use render::{InvalidField, Scene};

use super::face_change::FaceChange;
use super::neighbours::Neighbours;
use super::probes::{Place, Probes};
use super::search::{KnownTangencies, SAME_DEPTH, Searches, first_reach, is_same};
use super::visibility::visible;
use crate::crossing::{Crossing, tolerance};
use crate::record::FilmLine;
use trace::{Start, Tangency};

/// Crossings of lines with visible silhouettes, and the number of rays of the search.
pub(super) struct Crossings<R: Real> {
    pub(super) crossings: Vec<Crossing<R>>,
    pub(super) rays: u64,
}

/// The largest number of rounds, each of which halves the intervals whose ends hit different
/// surfaces.
const HALVINGS: u32 = 12;

/// Finds the crossings of lines with visible silhouettes. Each line has probes at its ends and at
/// the s in `inner`.
///
/// A search starts at each probe ray that passes a surface. It uses Newton's method, from the
/// closest approach that the tracer recorded. A crossing starts searches on the lines beside its
/// own, so that all lines find a thin part once one ray has met it. If two neighbouring probes hit
/// different surfaces and no crossing lies between them, a probe is added halfway.
///
/// It can miss a part that lies between all probes of a pixel and shows in none of them; more
/// probes find it.
pub(super) fn crossings<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    inner: &[f64],
) -> Result<Crossings<R>, InvalidField> {
    let mut fresh: Vec<Place> =
        (0..lines.len()).flat_map(|l| [0.0, inner[l], 1.0].map(|s| (l, s))).collect();
    let mut probes = Probes::new(lines.len());
    probes.add(scene, lines, &fresh)?;
    let mut known = KnownTangencies::new(lines.len());
    let neighbours = Neighbours::new(lines);
    let mut crossings = Vec::new();
    for _ in 0..HALVINGS {
        let mut searches = probes.searches(scene, lines, &fresh);
        while !searches.is_empty() {
            let before = known.count();
            known.search(scene, lines, &searches);
            for visible in visible(scene, lines, known.since(before))? {
                probes.add_sides(&visible);
                crossings.push(visible.crossing);
            }
            searches = neighbours.searches(scene, lines, &known, known.since(before));
        }
        fresh = probes.unexplained(scene, lines);
        if fresh.is_empty() {
            break;
        }
        probes.add(scene, lines, &fresh)?;
    }
    let rays = probes.rays + known.count() as u64;
    Ok(Crossings { crossings, rays })
}

/// The first step of a search along a ray, as a share of the distance to the surface behind.
const SHARE_OF_GAP: f64 = 0.1;

/// The largest number of searches for one silhouette at a known place.
const ATTEMPTS: i32 = 4;

/// The first step of each of these, as a share of that of the one before. Where a ray passes an
/// edge close to another face, f rises behind the edge for a short way only.
const SHORTER: f64 = 0.1;

/// The crossings with the silhouettes at known places: those of changes from one face to another
/// that does not meet it there.
///
/// [`crossings`] takes two depths for those of one surface if a ball as large as the solid could
/// have both. So it misses silhouettes in front of a surface close behind, and these are among
/// them.
/// Those of `known`, sorted by line, are left out: the tracer can pass through a solid that is
/// shorter than its shortest step along the ray, so that a known silhouette seems to be further
/// inside.
pub(super) fn crossings_at<R: Real>(
    scene: &Scene<'_, R>,
    lines: &[FilmLine],
    places: &[FaceChange<R>],
    known: &[Crossing<R>],
) -> Result<Crossings<R>, InvalidField> {
    if places.is_empty() {
        return Ok(Crossings { crossings: Vec::new(), rays: 0 });
    }
    let mut found = KnownTangencies::new(lines.len());
    let margin = tolerance::<R>();
    let range = |place: &FaceChange<R>| [place.ends[0].0 - margin, place.ends[1].0 + margin];
    let mut left: Vec<&FaceChange<R>> = places.iter().collect();
    for attempt in 0..ATTEMPTS {
        let mut searches = Searches::new();
        for place in &left {
            let [(from, first), (to, second)] = place.ends;
            let (s, t) = if first.t < second.t { (from, first.t) } else { (to, second.t) };
            // The minimum of f is in front of the surface behind.
            let behind = (first.t - second.t).abs() * R::of(SHARE_OF_GAP);
            let widest = first_reach(scene, lines[place.line].camera, t).min(behind);
            let reach = widest * R::of(SHORTER.powi(attempt));
            let start = Start { s: R::of(s), t, range: [R::zero(); 2], reach, steepest: R::one() };
            searches.push(place.line, range(place), start);
        }
        found.search(scene, lines, &searches);
        left.retain(|place| {
            let [from, to] = range(place);
            let is_it = |tangency: &Tangency<R>| (from..=to).contains(&tangency.s.to_double());
            !found.of(place.line).any(is_it)
        });
        if left.is_empty() {
            break;
        }
    }
    let visible = visible(scene, lines, found.since(0))?;
    let is_new = |new: &Crossing<R>| {
        let first = known.partition_point(|old| old.line < new.line);
        let same = scene.tracing_scale(lines[new.line].camera, new.rim.t) * R::of(SAME_DEPTH);
        let mut of_line = known[first..].iter().take_while(|old| old.line == new.line);
        !of_line.any(|old| is_same(old.s - new.s, old.rim.t - new.rim.t, same))
    };
    let rays = found.count() as u64;
    let crossings = visible.into_iter().map(|visible| visible.crossing).filter(is_new).collect();
    Ok(Crossings { crossings, rays })
}
