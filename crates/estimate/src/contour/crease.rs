//! Creases on the edges of the grid: places where the normal jumps and the depth does not.

use field::{Real, Vector3};
use glam::DVec2;
use render::{InvalidField, Sample, Scene, normals};

use super::edge::{DepthJump, Event, EventKind, GridEdge};
use crate::crossing::is_grazing;

/// Halvings of an edge: an edge of 1/16 pixels is then 1e-9 pixels long.
const HALVINGS: u32 = 26;

/// The least difference of two unit normals that counts as a jump after all halvings. On a smooth
/// surface the difference halves with the edge.
const TURN: f64 = 2e-3;

/// The largest difference in depth of two faces at a crease, in [`Scene::tracing_scale`].
const SAME_DEPTH: f64 = 1e-3;

/// The hit at one end of an edge.
#[derive(Clone, Copy, Debug)]
struct End<R: Real> {
    u: DVec2,
    t: R,
    x: R::Vec3,
    /// ∇f at the hit, and its direction.
    gradient: R::Vec3,
    normal: R::Vec3,
    radiance: R::Vec3,
}

/// A part of an edge whose ends have different normals.
struct Interval<R: Real> {
    /// The edge, by its number.
    edge: usize,
    camera: usize,
    ends: [End<R>; 2],
}

/// The difference of the normals at two ends.
fn turn<R: Real>(a: &End<R>, b: &End<R>) -> f64 {
    (a.normal - b.normal).length().to_double()
}

impl<R: Real> Interval<R> {
    fn middle(&self) -> Sample {
        Sample { camera: self.camera, u: (self.ends[0].u + self.ends[1].u) * 0.5 }
    }

    /// Keeps the half with the larger difference of normals.
    fn halve(&mut self, middle: End<R>) {
        let moved = usize::from(turn(&self.ends[0], &middle) >= turn(&middle, &self.ends[1]));
        self.ends[moved] = middle;
    }

    fn turns(&self) -> bool {
        turn(&self.ends[0], &self.ends[1]) > TURN
    }

    /// The event of the crease if the two faces meet here, or of the silhouette of the nearer one.
    /// The motion of a crease follows from both faces: see `refined`.
    fn event(&self, scene: &Scene<'_, R>) -> Option<Event<R>> {
        let [a, b] = &self.ends;
        let (d, du) = scene.cameras[self.camera].direction_du(a.u);
        let d = R::Vec3::of(d);
        let grazing = [a, b].map(|end| is_grazing::<R>(end.normal, d));
        let scale = scene.tracing_scale(self.camera, a.t.min(b.t));
        if (a.t - b.t).abs() > scale * R::of(SAME_DEPTH) {
            let (near, far) = if a.t < b.t { (a, b) } else { (b, a) };
            let sample = Sample { camera: self.camera, u: near.u };
            let contrast = near.radiance - far.radiance;
            return DepthJump { sample, t: near.t, contrast, grazing }.silhouette(scene);
        }
        let (along_a, along_b) = (a.gradient.dot(d), b.gradient.dot(d));
        // The film gradient of the crease, up to a factor.
        let across = du.map(|du| {
            let x = R::Vec3::of(du) * a.t;
            a.gradient.dot(x) * along_b - along_a * b.gradient.dot(x)
        });
        let length = (across[0] * across[0] + across[1] * across[1]).sqrt();
        let way = b.u - a.u;
        let towards_b = R::of(way.x) * across[0] + R::of(way.y) * across[1];
        let contrast =
            (a.radiance - b.radiance) * (towards_b.signum() / length.max(R::min_positive_value()));
        let rgb = [contrast * along_b, -(contrast * along_a)];
        let (u, t, points) = (a.u, a.t, [a.x, b.x]);
        let kind = EventKind::Crease;
        (length > R::zero()).then_some(Event { kind, grazing, u, t, points, rgb })
    }
}

/// The hits at film positions, `None` for a ray without a hit.
fn ends<R: Real>(
    scene: &Scene<'_, R>,
    samples: &[Sample],
) -> Result<Vec<Option<End<R>>>, InvalidField> {
    let primary = scene.primary(samples)?;
    let gradient: Vec<R::Vec3> = primary.hits.iter().map(|hit| hit.gradient).collect();
    let mut ends = vec![None; samples.len()];
    for ((hit, x), normal) in
        primary.hits.iter().zip(&primary.surface.x).zip(normals::<R>(&gradient))
    {
        let (u, radiance) = (samples[hit.sample].u, primary.samples[hit.sample].radiance);
        ends[hit.sample] =
            Some(End { u, t: hit.t, x: *x, gradient: hit.gradient, normal, radiance });
    }
    Ok(ends)
}

/// Adds the crossings of edges with creases: at most one on each side of a silhouette.
pub(super) fn locate<R: Real>(
    scene: &Scene<'_, R>,
    edges: &mut [GridEdge<R>],
) -> Result<(), InvalidField> {
    let parts: Vec<(usize, usize, [DVec2; 2])> = edges
        .iter()
        .enumerate()
        .flat_map(|(i, edge)| edge.parts.iter().map(move |part| (i, edge.camera, *part)))
        .collect();
    let at = |end: usize| {
        let sample = |(_, camera, part): &(usize, usize, [DVec2; 2])| Sample {
            camera: *camera,
            u: part[end],
        };
        ends(scene, &parts.iter().map(sample).collect::<Vec<_>>())
    };
    let (first, second) = (at(0)?, at(1)?);
    let mut open: Vec<Interval<R>> = Vec::new();
    for ((edge, camera, _), (a, b)) in parts.into_iter().zip(first.into_iter().zip(second)) {
        if let (Some(a), Some(b)) = (a, b) {
            open.push(Interval { edge, camera, ends: [a, b] });
        }
    }
    open.retain(Interval::turns);
    for _ in 0..HALVINGS {
        let samples: Vec<Sample> = open.iter().map(Interval::middle).collect();
        let mut middles = ends(scene, &samples)?.into_iter();
        open.retain_mut(|interval| {
            let middle = middles.next().flatten();
            middle.is_some_and(|middle| {
                interval.halve(middle);
                interval.turns()
            })
        });
    }
    for interval in &open {
        edges[interval.edge].events.extend(interval.event(scene));
    }
    Ok(())
}
