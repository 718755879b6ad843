//! Where the object is: the bounding sphere, from what the data set says, the cameras, and the background.

use field::Sphere;
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

use super::{Background, Dataset, View};
use crate::error::InputError;

/// Cells along a side of the carved grid.
const GRID: usize = 64;

/// Room around what carving leaves, as a factor on the radius: cells are coarse, and warp fields need both sides of a
/// silhouette.
const MARGIN: f64 = 1.1;

/// A background less certain than this is not carved with.
const TRUSTED: f32 = 0.3;

/// The share of views that may disagree with a cell and leave it: shadows as dark as the background happen.
const DISSENT: f64 = 0.1;

/// The share of a cell's footprint that must not look like background.
const FOREGROUND: f64 = 0.05;

/// The bounding sphere and the background: `asked` if there is one, else what the data set says, else an estimate.
pub fn surroundings(dataset: &Dataset, asked: Option<Sphere<f64>>) -> (Sphere<f64>, Background) {
    let views = &dataset.train;
    if let Some(known) = asked.or(dataset.bounds) {
        return (known, Background::estimate(views, &known));
    }
    let wide = seen_sphere(views, |half| half.length());
    let background = Background::estimate(views, &wide);
    let carved = (background.confidence >= TRUSTED).then(|| carve(views, &wide, &background)).flatten();
    let sphere = carved.unwrap_or_else(|| seen_sphere(views, DVec2::min_element));
    (sphere, Background::estimate(views, &sphere))
}

/// Refuses a camera inside the bounding sphere: from there the object has no silhouette.
///
/// # Errors
/// On the first such camera.
pub fn check_cameras(dataset: &Dataset, bounds: &Sphere<f64>) -> Result<(), InputError> {
    let inside = |v: &&View| (v.camera.eye - bounds.center).length() <= bounds.radius;
    match dataset.train.iter().chain(&dataset.test).find(inside) {
        None => Ok(()),
        Some(view) => {
            let distance = (view.camera.eye - bounds.center).length();
            let found = format!("a camera {distance:.4} from the centre {:.4}", bounds.center);
            let expected = format!("all cameras outside the bounding radius {:.4} (see --bounds)", bounds.radius);
            Err(InputError::new(&dataset.path, &view.name, found, expected))
        }
    }
}

/// The point nearest to all optical axes, in the least-squares sense; the cameras' mean if they are all parallel.
pub(crate) fn axes_center(views: &[View]) -> DVec3 {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for view in views {
        let d = view.camera.forward;
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        normal += across;
        right += across * view.camera.eye;
    }
    let mean = views.iter().map(|v| v.camera.eye).sum::<DVec3>() / views.len() as f64;
    // One view, or parallel ones: a point in front, at a unit distance.
    let parallel = normal.determinant().abs() < 1e-9 * (views.len() as f64).powi(3);
    if parallel { mean + views[0].camera.forward } else { normal.inverse() * right }
}

/// The sphere around the axes' centre that the median view sees; `extent` picks how much of the half film size (in
/// tangents) counts.
fn seen_sphere(views: &[View], extent: impl Fn(DVec2) -> f64) -> Sphere<f64> {
    let center = axes_center(views);
    let mut radii: Vec<f64> = views
        .iter()
        .map(|v| {
            let half = DVec2::new(f64::from(v.camera.width), f64::from(v.camera.height)) / 2.0 / v.camera.focal;
            (v.camera.eye - center).length() * extent(half).atan().sin()
        })
        .collect();
    radii.sort_by(f64::total_cmp);
    let nearest = views.iter().map(|v| (v.camera.eye - center).length()).fold(f64::INFINITY, f64::min);
    Sphere { center, radius: radii[radii.len() / 2].min(0.9 * nearest) }
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

    /// The share of foreground in a box of half size `reach` about `u`; `None` if it leaves the film.
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

/// A sphere around the coarse visual hull: what in almost all views that see it does not look like background.
fn carve(views: &[View], within: &Sphere<f64>, background: &Background) -> Option<Sphere<f64>> {
    let foreground: Vec<Foreground> = views.par_iter().map(|v| Foreground::new(v, background)).collect();
    let cell = 2.0 * within.radius / GRID as f64;
    let point = |i: usize| {
        let index = DVec3::new((i % GRID) as f64, (i / GRID % GRID) as f64, (i / GRID / GRID) as f64);
        within.center - within.radius + (index + 0.5) * cell
    };
    let solid: Vec<bool> = (0..GRID.pow(3))
        .into_par_iter()
        .map(|i| {
            let x = point(i);
            let (mut seen, mut against) = (0, 0);
            for (view, foreground) in views.iter().zip(&foreground) {
                let depth = (x - view.camera.eye).dot(view.camera.forward);
                let reach = 0.5 * cell * view.camera.focal.max_element() / depth;
                if let Some(share) = view.camera.project(x).and_then(|u| foreground.share(u, reach)) {
                    seen += 1;
                    against += u32::from(share < FOREGROUND);
                }
            }
            seen >= 2 && f64::from(against) <= DISSENT * f64::from(seen)
        })
        .collect();
    // Single cells that noise left do not count.
    let inner = |i: usize| {
        let steps = [1, GRID, GRID * GRID];
        solid[i] && steps.iter().all(|s| i >= *s && i + s < solid.len() && (solid[i - s] || solid[i + s]))
    };
    let left: Vec<DVec3> = (0..solid.len()).filter(|&i| inner(i)).map(point).collect();
    let share = left.len() as f64 / solid.len() as f64;
    if left.is_empty() || share > 0.4 {
        return None;
    }
    let (low, high) = left.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    let mut center = (low + high) / 2.0;
    // A few steps towards the farthest cell, each shorter (Bădoiu and Clarkson), find the smallest sphere closely.
    let farthest = |c: DVec3| left.iter().copied().max_by(|a, b| (*a - c).length().total_cmp(&(*b - c).length()));
    for step in 2..50 {
        center += (farthest(center)? - center) / f64::from(step);
    }
    let radius = (farthest(center)? - center).length() + 0.87 * cell;
    Some(Sphere { center, radius: MARGIN * radius })
}
