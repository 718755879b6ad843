//! Edges of the grid, and their crossings with silhouettes.

use field::{Real, Vector3};
use glam::DVec2;
use render::{InvalidField, Sample, Scene};

use crate::crossing::grazing_samples;

/// Halvings of an edge: an edge of 1/16 pixels is then 1e-9 pixels long.
const HALVINGS: u32 = 26;

/// The least jump in depth, in [`Scene::tracing_scale`], that counts as a silhouette after all
/// halvings. At a surface seen edge-on the depth changes by the square root of the edge's length,
/// about 1e-4.
const JUMP: f64 = 1e-3;

/// Distances before and behind a silhouette point at which the minimum of f is looked for: the
/// first, in [`Scene::tracing_scale`], the factor from one to the next, and their number. The first
/// row is enough where f is smooth. In the second one are edges just in front of another surface.
const BESIDE: [(f64, f64, u32); 2] = [(1e-4, 3.0, 6), (1e-6, 1.3, 40)];

/// The kind of curve that an edge of a cell crosses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EventKind {
    Silhouette,
    Crease,
}

/// A crossing of an edge of a cell with a curve along which the radiance jumps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Event<R: Real> {
    pub(super) kind: EventKind,
    /// Whether the surface before and that after the crossing are at a grazing angle.
    pub(super) grazing: [bool; 2],
    pub(super) u: DVec2,
    /// The depth of the curve, in world units.
    pub(super) t: R,
    /// Two points whose values of f move the curve: of the ray, around its minimum of f, or on the
    /// two faces. In world units.
    pub(super) points: [R::Vec3; 2],
    /// −∂(pixel value)/∂f at the points for a curve of one pixel of length, linear RGB per world
    /// unit.
    pub(super) rgb: [R::Vec3; 2],
}

/// An edge of the grid.
pub(super) struct GridEdge<R: Real> {
    pub(super) camera: usize,
    /// The film positions of its ends.
    pub(super) ends: [DVec2; 2],
    /// Its crossings with silhouettes and creases.
    pub(super) events: Vec<Event<R>>,
    /// Its parts on both sides of a silhouette; the whole edge if there is none.
    pub(super) parts: Vec<[DVec2; 2]>,
}

impl<R: Real> GridEdge<R> {
    pub(super) fn new(camera: usize, ends: [DVec2; 2]) -> Self {
        GridEdge { camera, ends, events: Vec::new(), parts: vec![ends] }
    }
}

/// A part of an edge whose ends see different surfaces.
struct Interval<R> {
    /// The edge, by its number.
    edge: usize,
    camera: usize,
    ends: [DVec2; 2],
    /// The depths at the ends; infinite for a ray without a hit.
    depth: [R; 2],
}

impl<R: Real> Interval<R> {
    fn middle(&self) -> DVec2 {
        (self.ends[0] + self.ends[1]) * 0.5
    }

    /// The end with the nearer surface.
    fn near(&self) -> usize {
        usize::from(self.depth[1] < self.depth[0])
    }

    fn sample(&self, end: usize) -> Sample {
        Sample { camera: self.camera, u: self.ends[end] }
    }

    fn jumps(&self, scene: &Scene<'_, R>) -> bool {
        let [a, b] = self.depth;
        a != b && (a - b).abs() > scene.tracing_scale(self.camera, a.min(b)) * R::of(JUMP)
    }

    /// Keeps the half with the larger jump; `t` is the depth at the middle.
    fn halve(&mut self, t: R) {
        // Infinite between a hit and a miss, 0 between two misses.
        let jump = |a: R, b: R| if a == b { R::zero() } else { (a - b).abs() };
        let moved = usize::from(jump(self.depth[0], t) >= jump(t, self.depth[1]));
        (self.ends[moved], self.depth[moved]) = (self.middle(), t);
    }
}

/// The depths at film positions, in world units; infinite for a ray without a hit.
fn depths<R: Real>(scene: &Scene<'_, R>, samples: &[Sample]) -> Result<Vec<R>, InvalidField> {
    let traced = scene.trace(samples)?;
    let depth = |traced: Option<render::TracedRay<R>>| traced.and_then(|traced| traced.depth());
    Ok(traced.into_iter().map(|traced| depth(traced).unwrap_or(R::infinity())).collect())
}

/// Sets the event of every edge that crosses a silhouette.
pub(super) fn locate<R: Real>(
    scene: &Scene<'_, R>,
    edges: &mut [GridEdge<R>],
) -> Result<(), InvalidField> {
    let ends = |end: usize| {
        let samples: Vec<Sample> =
            edges.iter().map(|e| Sample { camera: e.camera, u: e.ends[end] }).collect();
        depths(scene, &samples)
    };
    let (first, second) = (ends(0)?, ends(1)?);
    let mut open: Vec<Interval<R>> = edges
        .iter()
        .zip(first.into_iter().zip(second))
        .enumerate()
        .map(|(edge, (GridEdge { camera, ends, .. }, (a, b)))| Interval {
            edge,
            camera: *camera,
            ends: *ends,
            depth: [a, b],
        })
        .filter(|interval| interval.jumps(scene))
        .collect();
    for _ in 0..HALVINGS {
        let samples: Vec<Sample> =
            open.iter().map(|i| Sample { camera: i.camera, u: i.middle() }).collect();
        for (interval, t) in open.iter_mut().zip(depths(scene, &samples)?) {
            interval.halve(t);
        }
        open.retain(|interval| interval.jumps(scene));
    }
    describe(scene, edges, &open)
}

/// Sets the events of the intervals that are left after all halvings: contrast, silhouette point
/// and gradient.
fn describe<R: Real>(
    scene: &Scene<'_, R>,
    edges: &mut [GridEdge<R>],
    open: &[Interval<R>],
) -> Result<(), InvalidField> {
    let inside: Vec<Sample> = open.iter().map(|i| i.sample(i.near())).collect();
    let outside: Vec<Sample> = open.iter().map(|i| i.sample(1 - i.near())).collect();
    let (front, back) = (scene.primary(&inside)?, scene.primary(&outside)?);
    let grazing_outside = grazing_samples(&back);
    for (k, interval) in open.iter().enumerate() {
        let [from, to] = edges[interval.edge].ends;
        edges[interval.edge].parts = vec![[from, interval.ends[0]], [interval.ends[1], to]];
        let mut grazing = [grazing_outside[k]; 2];
        grazing[interval.near()] = true;
        let place = DepthJump {
            sample: interval.sample(interval.near()),
            t: interval.depth[interval.near()],
            contrast: front.samples[k].radiance - back.samples[k].radiance,
            grazing,
        };
        edges[interval.edge].events.extend(place.silhouette(scene));
    }
    Ok(())
}

/// A place where the depth jumps.
pub(super) struct DepthJump<R: Real> {
    /// The sample just inside.
    pub(super) sample: Sample,
    /// Its depth, in world units.
    pub(super) t: R,
    /// The radiance inside minus the radiance outside.
    pub(super) contrast: R::Vec3,
    /// Whether the surface before and that after the place are at a grazing angle.
    pub(super) grazing: [bool; 2],
}

impl<R: Real> DepthJump<R> {
    /// The silhouette at the place, if f has a minimum along the ray there.
    pub(super) fn silhouette(&self, scene: &Scene<'_, R>) -> Option<Event<R>> {
        let DepthJump { sample: Sample { camera: number, u }, t, .. } = *self;
        let camera = &scene.cameras[number];
        let (d, du) = camera.direction_du(u);
        let (eye, d) = (R::Vec3::of(camera.eye), R::Vec3::of(d));
        let minimum = minimum_around(scene, eye, d, t, scene.tracing_scale(number, t))?;
        let film = du.map(|du| minimum.gradient.dot(R::Vec3::of(du)) * t);
        // |∇_u m| of m = min_t f, in world units per pixel.
        let slope = (film[0] * film[0] + film[1] * film[1]).sqrt();
        let contrast = self.contrast * (R::one() / slope.max(R::min_positive_value()));
        let rgb = minimum.weights.map(|weight| contrast * weight);
        let (kind, grazing, points) = (EventKind::Silhouette, self.grazing, minimum.points);
        Some(Event { kind, grazing, u, t, points, rgb })
    }
}

/// A minimum of f along a ray, enclosed by two points with weights that sum to 1.
struct Minimum<R: Real> {
    points: [R::Vec3; 2],
    weights: [R; 2],
    /// The weighted mean of the gradients at the points; it is orthogonal to the ray.
    gradient: R::Vec3,
}

/// The minimum of f near the distance `t` along a ray, if two points around `t` enclose one.
///
/// `scale` is the tracing scale there, in world units.
fn minimum_around<R: Real>(
    scene: &Scene<'_, R>,
    eye: R::Vec3,
    d: R::Vec3,
    t: R,
    scale: R,
) -> Option<Minimum<R>> {
    let distances = BESIDE.iter().flat_map(|&(first, factor, number)| {
        (0..number).map(move |i| scale * R::of(first * factor.powi(i as i32)))
    });
    for beside in distances {
        let points = [eye + d * (t - beside), eye + d * (t + beside)];
        let (mut f, mut g) = ([R::zero(); 2], [R::Vec3::zero(); 2]);
        scene.field.value_gradient(&points, &mut f, &mut g);
        let slope = g.map(|g| g.dot(d));
        if slope[0] < R::zero() && slope[1] > R::zero() {
            let fraction = -slope[0] / (slope[1] - slope[0]);
            let weights = [R::one() - fraction, fraction];
            let gradient = g[0] * weights[0] + g[1] * weights[1];
            return Some(Minimum { points, weights, gradient });
        }
    }
    None
}
