//! The plane of a table in a surface.

use glam::{DMat3, DVec3};
use metrics::SurfacePoint;
use random::{Name, Stream};
use rayon::prelude::*;

/// The largest angle between a table's normal and the upward direction, in degrees. The mean
/// upward direction of cameras that look down from one side is tilted by as much as they look down.
const MOST_DEGREES: f64 = 45.0;

/// A point is on a plane if it is this close, in bounding radii.
const ON_PLANE: f64 = 0.01;

/// The largest angle between the normal of a point on the plane and that of the plane: its cosine.
const LEAST_COSINE: f64 = 0.866;

/// The least share of the surface that lies on a table's plane.
const LEAST_SHARE: f64 = 0.05;

/// The least share of the surface above a table: the top face of a box is none.
const LEAST_ABOVE: f64 = 0.02;

/// The largest share of the surface below a table, which hides its underside. A ball has caps that
/// are flat enough, and nearly all of it is below them.
const MOST_BELOW: f64 = 0.5;

/// The least share of the cameras above a table: those that see it.
const LEAST_CAMERAS: f64 = 0.9;

/// The number of planes tried. If a quarter of the points that face upwards are on the table, the
/// chance that none of the planes has three of them is 1e-7.
const TRIALS: u64 = 1024;

/// The most points by which planes are compared.
const COMPARED: usize = 20_000;

/// Rounds of least squares.
const ROUNDS: usize = 5;

/// A plane with an upper side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// A point of the plane, world units.
    pub point: DVec3,
    /// The unit normal of the upper side.
    pub normal: DVec3,
}

impl Plane {
    /// The height of `x` above the plane, in world units.
    pub fn height(&self, x: DVec3) -> f64 {
        (x - self.point).dot(self.normal)
    }

    /// The plane through three points; `None` if they are on one line.
    fn through([a, b, c]: [DVec3; 3]) -> Option<Self> {
        let normal = (b - a).cross(c - a).try_normalize()?;
        Some(Plane { point: a, normal })
    }
}

const PLANE_TRIALS: Name = Name::new("points through which planes are tried", 29);

/// A flat and level part of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// Its plane. The upper side is that of the surface's normals.
    pub plane: Plane,
    /// The angle between the plane's normal and the upward direction or its opposite, degrees.
    pub degrees: f64,
    /// The part of the given area that lies on the plane, 0 to 1.
    pub share: f64,
}

/// The points of a surface, and the numbers by which planes are judged.
struct Search<'a> {
    points: &'a [SurfacePoint],
    areas: &'a [f64],
    eyes: &'a [DVec3],
    up: DVec3,
    tolerance: f64,
}

/// The areas of points on a plane, above it, and of all points.
#[derive(Clone, Copy, Default)]
struct Score {
    on: f64,
    above: f64,
    total: f64,
}

impl Score {
    /// The area below the plane.
    fn below(&self) -> f64 {
        self.total - self.on - self.above
    }
}

/// The plane on which the largest part of a surface lies, if it can be that of a table.
///
/// `points` are points of the surface with their outward normals, and `areas` the area that each
/// stands for. `eyes` are the positions of the cameras, `up` a unit vector, whose sign may be
/// wrong, and `radius` the bounding radius in world units. The plane
/// - is within 45° of level;
/// - has at least 5 % of the area: points within 1 % of the radius whose normals are within 30°;
/// - has at least 2 % of the area above it and at most half of the area below it;
/// - has nine tenths of the cameras above it.
///
/// The plane is the best of 1024 planes through three random points that face upwards (M. A.
/// Fischler, R. C. Bolles, "Random Sample Consensus: A Paradigm for Model Fitting with Applications
/// to Image Analysis and Automated Cartography", Communications of the ACM 1981), and then that of
/// least squares of the points on it. The result is a pure function of the arguments.
pub fn ground(
    points: &[SurfacePoint],
    areas: &[f64],
    eyes: &[DVec3],
    up: DVec3,
    radius: f64,
) -> Option<Ground> {
    let search = Search { points, areas, eyes, up, tolerance: ON_PLANE * radius };
    let facing: Vec<usize> =
        (0..points.len()).filter(|i| search.is_level(points[*i].normal)).collect();
    let stride = points.len().div_ceil(COMPARED).max(1);
    let stream = Stream::of_seed(0).named(PLANE_TRIALS);
    let try_plane = |trial: u64| {
        let pick = |k: u64| {
            let place = stream.at(trial).at(k).unit() * facing.len() as f64;
            facing.get(place as usize).map(|i| points[*i])
        };
        let three = [pick(0)?, pick(1)?, pick(2)?];
        let plane = Plane::through(three.map(|p| p.position))?;
        let outward: DVec3 = three.iter().map(|p| p.normal).sum();
        let sign = if plane.normal.dot(outward) < 0.0 { -1.0 } else { 1.0 };
        let plane = Plane { normal: sign * plane.normal, ..plane };
        let score = search.score(&plane, stride);
        search.is_table(&plane, &score).then_some((score.on, plane))
    };
    let tried: Vec<_> = (0..TRIALS).into_par_iter().map(try_plane).collect();
    let best = tried.into_iter().flatten().reduce(|a, b| if b.0 > a.0 { b } else { a });
    let plane = (0..ROUNDS).fold(best?.1, |plane, _| search.fitted(&plane).unwrap_or(plane));
    let score = search.score(&plane, 1);
    search.is_table(&plane, &score).then(|| Ground {
        plane,
        degrees: plane.normal.dot(up).abs().min(1.0).acos().to_degrees(),
        share: score.on / score.total,
    })
}

impl Search<'_> {
    fn is_level(&self, normal: DVec3) -> bool {
        normal.dot(self.up).abs() >= MOST_DEGREES.to_radians().cos()
    }

    fn is_on(&self, plane: &Plane, point: &SurfacePoint) -> bool {
        plane.height(point.position).abs() <= self.tolerance
            && plane.normal.dot(point.normal) >= LEAST_COSINE
    }

    /// The areas of every `stride`-th point.
    fn score(&self, plane: &Plane, stride: usize) -> Score {
        let mut score = Score::default();
        for (point, area) in self.points.iter().zip(self.areas).step_by(stride) {
            score.total += area;
            if self.is_on(plane, point) {
                score.on += area;
            } else if plane.height(point.position) > self.tolerance {
                score.above += area;
            }
        }
        score
    }

    fn is_table(&self, plane: &Plane, score: &Score) -> bool {
        let above = self.eyes.iter().filter(|eye| plane.height(**eye) > 0.0).count() as f64;
        self.is_level(plane.normal)
            && score.on >= LEAST_SHARE * score.total
            && score.above >= LEAST_ABOVE * score.total
            && score.below() <= MOST_BELOW * score.total
            && above >= LEAST_CAMERAS * self.eyes.len() as f64
            && score.total > 0.0
    }

    /// The plane of least squared distances of the points on `plane`, by area.
    fn fitted(&self, plane: &Plane) -> Option<Plane> {
        let on = || self.points.iter().zip(self.areas).filter(|(p, _)| self.is_on(plane, p));
        let total: f64 = on().map(|(_, area)| area).sum();
        let center = on().map(|(p, area)| p.position * *area).sum::<DVec3>() / total;
        let mut scatter = DMat3::ZERO;
        for (point, area) in on() {
            let d = point.position - center;
            scatter += DMat3::from_cols(d * d.x, d * d.y, d * d.z) * (*area / total);
        }
        let normal = least_direction(scatter, plane.normal)?;
        center.is_finite().then_some(Plane { point: center, normal })
    }
}

/// The eigenvector of the least eigenvalue of a scatter matrix, a unit vector on the side of
/// `start`, by inverse iteration; `None` if points are on one line, or a number is not finite.
fn least_direction(scatter: DMat3, start: DVec3) -> Option<DVec3> {
    let trace = scatter.x_axis.x + scatter.y_axis.y + scatter.z_axis.z;
    // The shift keeps the inverse finite for points exactly on a plane.
    let shifted = scatter + DMat3::from_diagonal(DVec3::splat(1e-9 * trace));
    let inverse = shifted.inverse();
    let mut direction = start;
    for _ in 0..30 {
        direction = (inverse * direction).try_normalize()?;
    }
    (direction.is_finite() && direction.dot(start) > LEAST_COSINE).then_some(direction)
}
