//! The visible silhouettes that lines of the film cross.

use field::Real;
use render::{InvalidField, Scene};

use super::neighbours::Neighbours;
use super::probes::{Place, Probes};
use super::search::KnownTangencies;
use super::visibility::visible;
use crate::film_line::{Crossing, FilmLine};

/// Crossings of lines, and the rays that they took.
pub(super) struct Crossings<R: Real> {
    pub(super) crossings: Vec<Crossing<R>>,
    pub(super) rays: u64,
}

/// Rounds of halving an interval whose ends see different surfaces.
const HALVINGS: u32 = 12;

/// Finds the visible silhouettes that lines cross. `inner` is the s of each line's probe between its
/// ends.
///
/// A silhouette is found from a ray that passes it, by Newton's method from the closest approach
/// that the tracer recorded. It is then followed to the lines beside, so that all lines find a thin
/// part once one ray has met it. Where two rays see different surfaces without a crossing between
/// them, a ray is added halfway. A part between all probes of a pixel that shows in none of them is
/// not found; more probes find it.
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
