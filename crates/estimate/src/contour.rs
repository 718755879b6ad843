//! Ground truth: silhouettes traced on a fine grid of the film.

use field::{Real, Vector3};
use glam::DVec2;
use trace::Outcome;

use super::lines::{Crossing, Line};
use super::pixels::{check_valid, first_invalid};
use super::refined::between;
use super::{Estimator, Pixel, Record, Sample, Setup};
use crate::InvalidField;

/// Silhouettes as polygons through the edges of a grid of cells, and the smooth part along the
/// grid's lines.
///
/// A cell's edge whose ends see different things is halved until it is 1e-9 pixels long; what is
/// seen at its two ends then gives contrast and silhouette point. The polygon's length is exact to
/// the square of a cell's size. Shares no search and no random number with the other estimators;
/// slow.
#[derive(Clone, Copy, Debug)]
pub struct Contour {
    /// Cells along a side of a pixel.
    cells: u32,
}

/// Halvings of an edge: a grid of 1/16 pixel ends at 1e-9 pixels.
const HALVINGS: u32 = 26;

/// A jump in depth that is still there after all halvings is a silhouette, in [`Setup::scale_at`].
/// Where a surface is seen edge-on it falls off by the square root of the edge's length: 1e-4.
const JUMP: f64 = 3e-3;

/// How far in front and behind a silhouette point its gradient is taken, in [`Setup::scale_at`].
const BESIDE: f64 = 1e-4;

/// A place where an edge of a cell crosses a silhouette.
#[derive(Clone, Copy, Debug)]
struct Event<R: Real> {
    u: DVec2,
    /// Depth of the silhouette.
    t: R,
    points: [R::Vec3; 2],
    weights: [R; 2],
    /// |∇_u m|.
    rise: R,
    contrast: R::Vec3,
    /// Whether the solid is left along the edge.
    leaves: bool,
}

/// An edge of the grid: its pixel, its ends, and whatever was found on it.
struct GridEdge<R: Real> {
    camera: usize,
    ends: [DVec2; 2],
    /// Depths seen at the ends; infinite for none.
    depth: [R; 2],
    event: Option<Event<R>>,
}

impl Contour {
    /// A grid with as many cells as samples, 4 to 256 along a side.
    pub fn new(spp: u32) -> Self {
        Contour { cells: (f64::from(spp).sqrt().ceil() as u32).clamp(4, 256) }
    }

    /// The edges of one pixel's grid: along x row by row, then along y column by column.
    fn edges<R: Real>(&self, pixel: &Pixel) -> Vec<GridEdge<R>> {
        let (n, corner) = (self.cells, DVec2::new(f64::from(pixel.x), f64::from(pixel.y)));
        let at = |axis: usize, line: u32, along: u32| {
            let (a, b) = (f64::from(along) / f64::from(n), f64::from(line) / f64::from(n));
            corner + if axis == 0 { DVec2::new(a, b) } else { DVec2::new(b, a) }
        };
        let place = move |axis, line, along| [at(axis, line, along), at(axis, line, along + 1)];
        (0..2)
            .flat_map(|axis| {
                (0..=n).flat_map(move |line| (0..n).map(move |along| (axis, line, along)))
            })
            .map(|(axis, line, along)| GridEdge {
                camera: pixel.camera,
                ends: place(axis, line, along),
                depth: [R::infinity(); 2],
                event: None,
            })
            .collect()
    }

    /// The index of an edge among its pixel's.
    fn index(&self, axis: u32, line: u32, along: u32) -> usize {
        let n = self.cells;
        ((axis * (n + 1) + line) * n + along) as usize
    }

    /// Adds the polygon's part in every cell of one pixel.
    fn add_cells<R: Real>(&self, pixel: u32, edges: &[GridEdge<R>], record: &mut Record<R>) {
        for y in 0..self.cells {
            for x in 0..self.cells {
                let four = [
                    self.index(0, y, x),
                    self.index(1, x + 1, y),
                    self.index(0, y + 1, x),
                    self.index(1, x, y),
                ];
                let events: Vec<Event<R>> = four.iter().filter_map(|&e| edges[e].event).collect();
                for (a, b, length) in pieces(&events) {
                    for event in [a, b] {
                        let rgb = event.contrast
                            * (R::of(0.5 * length) / event.rise.max(R::min_positive_value()));
                        for (x, weight) in event.points.into_iter().zip(event.weights) {
                            record.silhouettes.push(pixel, x, rgb * weight);
                        }
                    }
                }
            }
        }
    }

    /// Adds the smooth part: the grid's lines by the trapezoid rule.
    fn add_smooth<R: Real>(
        &self,
        setup: &Setup<'_, R>,
        pixels: &[Pixel],
        edges: &[Vec<GridEdge<R>>],
        record: &mut Record<R>,
    ) -> Result<(), InvalidField> {
        let (mut lines, mut crossings) = (Vec::new(), Vec::new());
        for (index, (pixel, edges)) in pixels.iter().zip(edges).enumerate() {
            for (axis, line) in
                (0..2).flat_map(|axis| (0..=self.cells).map(move |line| (axis, line)))
            {
                let ends = if line == 0 || line == self.cells { 0.5 } else { 1.0 };
                for along in 0..self.cells {
                    let Some(event) = &edges[self.index(axis, line, along)].event else { continue };
                    let s = (event.u - DVec2::new(f64::from(pixel.x), f64::from(pixel.y)))
                        [axis as usize];
                    let Event { points, weights, contrast, leaves, .. } = *event;
                    crossings.push(Crossing {
                        line: lines.len(),
                        s,
                        leaves,
                        points,
                        weights,
                        rise: [R::zero(); 2],
                        contrast,
                    });
                }
                lines.push(Line {
                    pixel: index as u32,
                    camera: pixel.camera,
                    axis: axis as usize,
                    start: edges[self.index(axis, line, 0)].ends[0],
                    share: ends / f64::from(self.cells),
                });
            }
        }
        between(setup, &lines, (&vec![0.5; lines.len()], self.cells), &crossings, record)
    }
}

impl<R: Real> Estimator<R> for Contour {
    fn record(
        &self,
        setup: &Setup<'_, R>,
        pixels: &[Pixel],
        _: u64,
    ) -> Result<Record<R>, InvalidField> {
        let mut record =
            Record { radiance: vec![R::Vec3::zero(); pixels.len()], ..Record::default() };
        let mut all = Vec::with_capacity(pixels.len());
        for (index, pixel) in pixels.iter().enumerate() {
            let mut edges = self.edges::<R>(pixel);
            locate(setup, &mut edges)?;
            self.add_cells(index as u32, &edges, &mut record);
            all.push(edges);
        }
        self.add_smooth(setup, pixels, &all, &mut record)?;
        Ok(record)
    }
}

/// The depths that film positions see; infinite where there is nothing.
fn depths<R: Real>(setup: &Setup<'_, R>, samples: &[Sample]) -> Result<Vec<R>, InvalidField> {
    let (_, found) = setup.find(samples);
    check_valid(setup, samples, first_invalid(&found))?;
    Ok(found
        .into_iter()
        .map(|f| f.filter(|f| f.outcome == Outcome::Hit).map_or(R::infinity(), |f| f.t))
        .collect())
}

/// Finds the silhouettes that the edges cross.
fn locate<R: Real>(setup: &Setup<'_, R>, edges: &mut [GridEdge<R>]) -> Result<(), InvalidField> {
    let ends = |edges: &[GridEdge<R>], end: usize| {
        let samples: Vec<Sample> =
            edges.iter().map(|e| Sample { camera: e.camera, u: e.ends[end] }).collect();
        depths(setup, &samples)
    };
    let (first, second) = (ends(edges, 0)?, ends(edges, 1)?);
    edges
        .iter_mut()
        .zip(first.into_iter().zip(second))
        .for_each(|(edge, (a, b))| edge.depth = [a, b]);
    let jumps = |camera: usize, depth: [R; 2]| {
        let threshold = setup.scale_at(camera, depth[0].min(depth[1])) * R::of(JUMP);
        depth[0] != depth[1] && (depth[0] - depth[1]).abs() > threshold
    };
    let mut open: Vec<(usize, [DVec2; 2], [R; 2])> = edges
        .iter()
        .enumerate()
        .filter(|(_, e)| jumps(e.camera, e.depth))
        .map(|(i, e)| (i, e.ends, e.depth))
        .collect();
    for _ in 0..HALVINGS {
        let middle = |ends: &[DVec2; 2]| (ends[0] + ends[1]) * 0.5;
        let samples: Vec<Sample> = open
            .iter()
            .map(|(i, ends, _)| Sample { camera: edges[*i].camera, u: middle(ends) })
            .collect();
        for ((_, ends, depth), t) in open.iter_mut().zip(depths(setup, &samples)?) {
            // The half with the larger jump: a miss beside a hit is one without bound, two misses
            // are none.
            let jump = |a: R, b: R| if a == b { R::zero() } else { (a - b).abs() };
            let side = usize::from(jump(depth[0], t) >= jump(t, depth[1]));
            (ends[side], depth[side]) = (middle(ends), t);
        }
        open.retain(|(i, _, depth)| jumps(edges[*i].camera, *depth));
    }
    describe(setup, edges, &open)
}

/// Contrast, silhouette point and gradient of the edges that were halved to the end.
fn describe<R: Real>(
    setup: &Setup<'_, R>,
    edges: &mut [GridEdge<R>],
    open: &[(usize, [DVec2; 2], [R; 2])],
) -> Result<(), InvalidField> {
    let end = |i: usize, ends: &[DVec2; 2], which: usize| Sample {
        camera: edges[i].camera,
        u: ends[which],
    };
    let near = |depth: &[R; 2]| usize::from(depth[1] < depth[0]);
    let inside: Vec<Sample> =
        open.iter().map(|(i, ends, depth)| end(*i, ends, near(depth))).collect();
    let outside: Vec<Sample> =
        open.iter().map(|(i, ends, depth)| end(*i, ends, 1 - near(depth))).collect();
    let (front, back) = (setup.primary(&inside), setup.primary(&outside));
    check_valid(setup, &inside, front.invalid)?;
    check_valid(setup, &outside, back.invalid)?;
    for (k, (i, ends, depth)) in open.iter().enumerate() {
        let t = depth[near(depth)];
        let (camera, u) = (&setup.cameras[edges[*i].camera], ends[near(depth)]);
        let (d, du) = camera.direction_du(u);
        let d = R::Vec3::of(d);
        let eye = R::Vec3::of(camera.eye);
        let Some((points, weights, gradient)) =
            straddle(setup, eye, d, (t, setup.scale_at(edges[*i].camera, t)))
        else {
            continue;
        };
        let rise = du.map(|du| gradient.dot(R::Vec3::of(du)) * t);
        edges[*i].event = Some(Event {
            u,
            t,
            points,
            weights,
            rise: (rise[0] * rise[0] + rise[1] * rise[1]).sqrt(),
            contrast: front.radiance[k] - back.radiance[k],
            leaves: near(depth) == 0,
        });
    }
    Ok(())
}

/// Two points around the silhouette point at t between which f has its minimum, their weights, and
/// the mean gradient.
#[allow(clippy::type_complexity, reason = "three results of one search")]
fn straddle<R: Real>(
    setup: &Setup<'_, R>,
    eye: R::Vec3,
    d: R::Vec3,
    (t, scale): (R, R),
) -> Option<([R::Vec3; 2], [R; 2], R::Vec3)> {
    let mut beside = scale * R::of(BESIDE);
    for _ in 0..6 {
        let x = [eye + d * (t - beside), eye + d * (t + beside)];
        let (mut f, mut g) = ([R::zero(); 2], [R::Vec3::zero(); 2]);
        setup.field.value_gradient(&x, &mut f, &mut g);
        let slope = g.map(|g| g.dot(d));
        if slope[0] < R::zero() && slope[1] > R::zero() {
            let share = -slope[0] / (slope[1] - slope[0]);
            let weights = [R::one() - share, share];
            return Some((x, weights, g[0] * weights[0] + g[1] * weights[1]));
        }
        beside *= R::of(3.0);
    }
    None
}

/// The pieces of silhouettes in a cell, as pairs of events with the length between them.
fn pieces<R: Real>(events: &[Event<R>]) -> Vec<(Event<R>, Event<R>, f64)> {
    // What belongs together is close in depth; beyond that, close on the film.
    let cost =
        |a: &Event<R>, b: &Event<R>| (a.t - b.t).abs().to_double() * 1e3 + (a.u - b.u).length();
    let piece = |a: usize, b: usize| (events[a], events[b], (events[a].u - events[b].u).length());
    let pair = |a: usize, b: usize| cost(&events[a], &events[b]);
    match events.len() {
        2 => vec![piece(0, 1)],
        // One silhouette ends behind another: its last piece reaches the other's chord.
        3 => {
            let options = [(0, 1, 2), (0, 2, 1), (1, 2, 0)];
            let best = options.into_iter().min_by(|x, y| pair(x.0, x.1).total_cmp(&pair(y.0, y.1)));
            best.map_or(Vec::new(), |(a, b, rest)| {
                let (p, q) = (events[a].u, events[b].u);
                let along = ((events[rest].u - p).dot(q - p)
                    / (q - p).length_squared().max(1e-300))
                .clamp(0.0, 1.0);
                let length = (events[rest].u - (p + (q - p) * along)).length();
                vec![piece(a, b), (events[rest], events[rest], length)]
            })
        }
        4 => {
            let options = [[(0, 1), (2, 3)], [(0, 2), (1, 3)], [(0, 3), (1, 2)]];
            let sum = |o: &[(usize, usize); 2]| pair(o[0].0, o[0].1) + pair(o[1].0, o[1].1);
            let best = options.iter().min_by(|x, y| sum(x).total_cmp(&sum(y)));
            best.map_or(Vec::new(), |pairs| pairs.iter().map(|(a, b)| piece(*a, *b)).collect())
        }
        _ => Vec::new(),
    }
}
