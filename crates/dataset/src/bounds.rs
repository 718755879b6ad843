//! Where the object is: the bounding sphere, from what the data set says, the cameras, and the
//! background.

use field::Sphere;
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

use super::{Background, Dataset, View};
use io::InputError;

/// Cells along a side of the carved grid.
const GRID: usize = 64;

/// Room around what carving leaves, as a factor on the radius: cells are coarse, and warp fields
/// need both sides of a silhouette.
const MARGIN: f64 = 1.1;

/// A background less certain than this is not carved with.
const TRUSTED: f32 = 0.3;

/// The share of views that may disagree with a cell and leave it: shadows as dark as the background
/// happen.
const DISSENT: f64 = 0.1;

/// The share of the views that must have a cell wholly on their film: what few cameras see, few
/// could carve away.
const SEEN: f64 = 0.5;

/// The first grid's size, in the radius of the sphere that fills the median view to its corners: an
/// object may be cut off by the frame, and its middle need not be where the cameras aim.
const GENEROUS: f64 = 1.5;

/// A part smaller than this share of the largest is noise, or a ghost where unrelated silhouettes
/// happen to overlap.
const DEBRIS: f64 = 0.05;

/// If more than this share of the ball is left, carving has found nothing.
const UNCARVED: f64 = 0.75;

/// The volume of a ball in that of the cube around it.
const BALL_OF_CUBE: f64 = std::f64::consts::PI / 6.0;

/// The share of a cell's footprint that must not look like background.
const FOREGROUND: f64 = 0.05;

/// Fewer points than this say nothing about the object.
const LEAST_POINTS: usize = 50;

/// The share of the points that the sphere must hold; the others are mismatches, or the table's far
/// corner.
const HELD: f64 = 0.98;

/// The bounding sphere and the background: `asked` if there is one, else what the data set says,
/// else an estimate: from a uniform background by carving, from the data set's surface points, or
/// else from what the cameras see.
pub fn surroundings(dataset: &Dataset, asked: Option<Sphere<f64>>) -> (Sphere<f64>, Background) {
    let views = &dataset.train;
    if let Some(known) = asked.or(dataset.bounds) {
        return (known, Background::estimate(views, &known));
    }
    let wide = seen_sphere(views, |half| half.length());
    let background = Background::estimate(views, &wide);
    let carved = (background.confidence >= TRUSTED)
        .then(|| carve_twice(views, &wide, &background))
        .flatten();
    let seen = seen_sphere(views, DVec2::min_element);
    let sphere = carved.or_else(|| around_points(&dataset.points, &wide)).unwrap_or(seen);
    (sphere, Background::estimate(views, &sphere))
}

/// Refuses a camera inside the bounding sphere, from where the object has no silhouette, and
/// cameras of which most look away from it, as they do when their poses are in another convention.
///
/// # Errors
/// On the first camera inside, or if more than half look away.
pub fn check_cameras(dataset: &Dataset, bounds: &Sphere<f64>) -> Result<(), InputError> {
    let views: Vec<&View> = dataset.train.iter().chain(&dataset.test).collect();
    let inside = |v: &&&View| (v.camera.eye - bounds.center).length() <= bounds.radius;
    if let Some(view) = views.iter().find(inside) {
        let distance = (view.camera.eye - bounds.center).length();
        let found = format!("a camera {distance:.4} from the centre {:.4}", bounds.center);
        let expected =
            format!("all cameras outside the bounding radius {:.4} (see --bounds)", bounds.radius);
        return Err(InputError::new(&dataset.path, &view.name, found, expected));
    }
    let away = views.iter().filter(|v| looks_away(v, bounds)).count();
    if 2 * away > views.len() {
        let found = format!("{away} of {} cameras look away from the bounding sphere", views.len());
        let expected = "cameras that look at it (poses in the OpenCV convention need their y and z axes negated; see --bounds)";
        return Err(InputError::new(&dataset.path, "poses", found, expected));
    }
    Ok(())
}

/// True if the sphere's centre is behind a camera.
pub fn looks_away(view: &View, bounds: &Sphere<f64>) -> bool {
    (bounds.center - view.camera.eye).dot(view.camera.forward) < 0.0
}

/// The point nearest to the rays through the films' centres, in the least-squares sense (the
/// optical axes, where the principal points are there); a point in front of the cameras' mean if
/// the rays are all parallel.
fn aim(views: &[View]) -> DVec3 {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    let toward = |v: &View| {
        v.camera.direction(DVec2::new(f64::from(v.camera.width), f64::from(v.camera.height)) / 2.0)
    };
    for view in views {
        let d = toward(view);
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        normal += across;
        right += across * view.camera.eye;
    }
    let mean = views.iter().map(|v| v.camera.eye).sum::<DVec3>() / views.len() as f64;
    // One view, or parallel ones: a point in front, at a unit distance.
    let parallel = normal.determinant().abs() < 1e-9 * (views.len() as f64).powi(3);
    if parallel { mean + toward(&views[0]) } else { normal.inverse() * right }
}

/// The sphere around the point aimed at that the median view sees; `extent` picks how much of the
/// half film size (in tangents) counts.
fn seen_sphere(views: &[View], extent: impl Fn(DVec2) -> f64) -> Sphere<f64> {
    let center = aim(views);
    let mut radii: Vec<f64> = views
        .iter()
        .map(|v| {
            let half = DVec2::new(f64::from(v.camera.width), f64::from(v.camera.height))
                / 2.0
                / v.camera.focal;
            (v.camera.eye - center).length() * extent(half).atan().sin()
        })
        .collect();
    radii.sort_by(f64::total_cmp);
    let nearest =
        views.iter().map(|v| (v.camera.eye - center).length()).fold(f64::INFINITY, f64::min);
    Sphere { center, radius: radii[radii.len() / 2].min(0.9 * nearest) }
}

/// A sphere around nearly all of the points within another: what the cameras turn about, without
/// what is behind it.
fn around_points(points: &[DVec3], within: &Sphere<f64>) -> Option<Sphere<f64>> {
    let inside = |p: &&DVec3| (**p - within.center).length() < within.radius;
    let points: Vec<DVec3> = points.iter().filter(inside).copied().collect();
    if points.len() < LEAST_POINTS {
        return None;
    }
    let middle = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let center = DVec3::new(middle(0), middle(1), middle(2));
    let mut distances: Vec<f64> = points.iter().map(|p| (*p - center).length()).collect();
    distances.sort_by(f64::total_cmp);
    let radius = MARGIN * distances[(HELD * (distances.len() - 1) as f64) as usize];
    (radius > 0.0).then_some(Sphere { center, radius })
}

/// How many pixels above and to the left of (x, y) do not look like background.
struct Foreground {
    width: usize,
    height: usize,
    sums: Vec<u32>,
}

impl Foreground {
    fn new(view: &View, background: &Background) -> Self {
        let (width, height) = (view.image.width as usize, view.image.height as usize);
        let mut sums = vec![0; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut row = 0;
            for x in 0..width {
                row += u32::from(background.probability(view.image.pixels[y * width + x]) < 0.5);
                sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + row;
            }
        }
        Foreground { width, height, sums }
    }

    /// The share of foreground in a box of half size `reach` about `u`; `None` if it leaves the
    /// film.
    fn share(&self, u: DVec2, reach: f64) -> Option<f64> {
        let (low, high) = ((u - reach).floor(), (u + reach).ceil());
        if low.min_element() < 0.0 || high.x > self.width as f64 || high.y > self.height as f64 {
            return None;
        }
        let at = |x: f64, y: f64| f64::from(self.sums[y as usize * (self.width + 1) + x as usize]);
        let sum = at(high.x, high.y) - at(low.x, high.y) - at(high.x, low.y) + at(low.x, low.y);
        Some(sum / ((high.x - low.x) * (high.y - low.y)))
    }
}

/// A sphere around the visual hull: found on a coarse grid, then again on a grid of that sphere's
/// size.
fn carve_twice(views: &[View], seen: &Sphere<f64>, background: &Background) -> Option<Sphere<f64>> {
    let foreground: Vec<Foreground> =
        views.par_iter().map(|v| Foreground::new(v, background)).collect();
    let coarse = carve(views, &foreground, &seen.scaled(GENEROUS))?;
    let fine = carve(views, &foreground, &coarse).unwrap_or(coarse);
    Some(fine.scaled(MARGIN))
}

/// A sphere around what in almost all of the views that see it does not look like background.
fn carve(views: &[View], foreground: &[Foreground], within: &Sphere<f64>) -> Option<Sphere<f64>> {
    let cell = 2.0 * within.radius / GRID as f64;
    let point = |i: usize| {
        let index =
            DVec3::new((i % GRID) as f64, (i / GRID % GRID) as f64, (i / GRID / GRID) as f64);
        within.center - within.radius + (index + 0.5) * cell
    };
    let stays = |i: usize| {
        let x = point(i);
        if (x - within.center).length() > within.radius {
            return false;
        }
        let (mut seen, mut against) = (0, 0);
        for (view, foreground) in views.iter().zip(foreground) {
            let depth = (x - view.camera.eye).dot(view.camera.forward);
            let reach = 0.5 * cell * view.camera.focal.max_element() / depth;
            if let Some(share) = view.camera.project(x).and_then(|u| foreground.share(u, reach)) {
                seen += 1;
                against += u32::from(share < FOREGROUND);
            }
        }
        f64::from(seen) >= (SEEN * views.len() as f64).max(2.0)
            && f64::from(against) <= DISSENT * f64::from(seen)
    };
    let solid: Vec<bool> = (0..GRID.pow(3)).into_par_iter().map(stays).collect();
    let left: Vec<DVec3> = main_parts(&solid).into_iter().map(point).collect();
    let share = left.len() as f64 / (solid.len() as f64 * BALL_OF_CUBE);
    // Half a cell's diagonal around the cells' centres holds the cells.
    let sphere = || enclosing_sphere(&left, 0.5 * 3f64.sqrt() * cell);
    if left.is_empty() || share > UNCARVED { None } else { sphere() }
}

/// The indices of the solid cells in the largest connected part and in those that are not much
/// smaller.
fn main_parts(solid: &[bool]) -> Vec<usize> {
    let mut visited = vec![false; solid.len()];
    let mut parts: Vec<Vec<usize>> = Vec::new();
    for seed in 0..solid.len() {
        if !solid[seed] || visited[seed] {
            continue;
        }
        visited[seed] = true;
        let mut part = vec![seed];
        let mut next = 0;
        while let Some(&i) = part.get(next) {
            next += 1;
            for step in [1, GRID, GRID * GRID] {
                // The place along this axis: cells at the grid's sides have one neighbour only.
                let along = i / step % GRID;
                let below = (along > 0).then(|| i - step);
                let above = (along + 1 < GRID).then(|| i + step);
                for neighbour in [below, above].into_iter().flatten() {
                    if solid[neighbour] && !visited[neighbour] {
                        visited[neighbour] = true;
                        part.push(neighbour);
                    }
                }
            }
        }
        parts.push(part);
    }
    let largest = parts.iter().map(Vec::len).max().unwrap_or(0);
    parts.retain(|part| part.len() as f64 >= DEBRIS * largest as f64);
    parts.concat()
}

/// The smallest sphere around points, closely, and `room` more.
fn enclosing_sphere(points: &[DVec3], room: f64) -> Option<Sphere<f64>> {
    let (low, high) = points
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    let mut center = (low + high) / 2.0;
    // Steps towards the farthest point, each shorter (Bădoiu and Clarkson 2003).
    let farthest = |c: DVec3| {
        points.iter().copied().max_by(|a, b| (*a - c).length().total_cmp(&(*b - c).length()))
    };
    for step in 2..50 {
        center += (farthest(center)? - center) / f64::from(step);
    }
    Some(Sphere { center, radius: (farthest(center)? - center).length() + room })
}
