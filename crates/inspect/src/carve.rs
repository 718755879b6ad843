//! A sphere around the visual hull of the photographs (Laurentini, "The Visual Hull Concept for
//! Silhouette-Based Image Understanding", IEEE PAMI 16(2), 1994).
//!
//! The visual hull is the set of points that no view shows as background. With exact silhouettes it
//! contains the object. Estimated silhouettes have errors: shadows and dim parts look like
//! background. So a grid cell is kept if nearly all of the views that see it show it as foreground,
//! and small parts are dropped. The result is an estimate, not a bound.

use field::Sphere;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use dataset::View;

/// Cells along a side of the grid.
const GRID: usize = 64;

/// The radius of the first grid's sphere, in radii of the sphere that fills the median view to its
/// corners. The frame may cut off the object, and the cameras need not aim at its middle.
const FIRST_GRID: f64 = 1.5;

/// The largest share of views that may show a kept cell as background. Shadows can be as dark as
/// the background.
const MOST_DISSENT: f64 = 0.1;

/// The least share of the views that must have a kept cell wholly on their film. Few views could
/// not carve a cell away.
const LEAST_SEEN: f64 = 0.5;

/// The least number of views that must have a kept cell wholly on their film.
const LEAST_VIEWS: f64 = 2.0;

/// The share of a cell's footprint that must be foreground for the view to keep the cell.
const LEAST_FOREGROUND: f64 = 0.05;

/// A part below this share of the largest part is dropped: noise, or a ghost where unrelated
/// silhouettes overlap.
const LEAST_PART: f64 = 0.05;

/// If more than this share of the ball is kept, carving has failed.
const MOST_KEPT: f64 = 0.75;

/// The volume of a ball divided by that of the cube around it.
const BALL_OF_CUBE: f64 = std::f64::consts::PI / 6.0;

/// The last step of the search for the smallest enclosing sphere; the first is 2.
const LAST_STEP: u32 = 49;

/// A sphere around the visual hull: estimated on a coarse grid, then on a grid of that sphere's
/// size. `in_view` is the sphere that fills the median view to its corners, and `is_foreground`
/// tells whether pixel `i` of a view, row-major, shows the object. `None` if nothing, or nearly
/// everything, is left.
pub(crate) fn visual_hull_sphere(
    views: &[View],
    in_view: &Sphere<f64>,
    is_foreground: impl Fn(usize, usize) -> bool + Sync,
) -> Option<Sphere<f64>> {
    let silhouette =
        |(number, view): (usize, &View)| Silhouette::new(view, |i| is_foreground(number, i));
    let silhouettes: Vec<Silhouette> = views.par_iter().enumerate().map(silhouette).collect();
    let coarse = carve(views, &silhouettes, &in_view.scaled(FIRST_GRID))?;
    Some(carve(views, &silhouettes, &coarse).unwrap_or(coarse))
}

/// The foreground of a view, as a summed-area table (Crow, "Summed-Area Tables for Texture
/// Mapping", SIGGRAPH 1984): (width + 1) × (height + 1) numbers of foreground pixels above and to
/// the left of each pixel corner.
struct Silhouette {
    width: usize,
    height: usize,
    sums: Vec<u32>,
}

impl Silhouette {
    fn new(view: &View, is_foreground: impl Fn(usize) -> bool) -> Self {
        let (width, height) = (view.image.width as usize, view.image.height as usize);
        let mut sums = vec![0; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut row = 0;
            for x in 0..width {
                row += u32::from(is_foreground(y * width + x));
                sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + row;
            }
        }
        Silhouette { width, height, sums }
    }

    /// The share of foreground in the box of half size `reach` pixels around the film position `u`,
    /// rounded outwards to whole pixels. `None` if the box leaves the film.
    fn share(&self, u: DVec2, reach: f64) -> Option<f64> {
        let (low, high) = (u - reach, u + reach);
        if low.min_element() < 0.0 || high.x > self.width as f64 || high.y > self.height as f64 {
            return None;
        }
        // A call of `floor` or `ceil` takes longer than the rest: numbers of at least 0 are cut.
        let up = |v: f64| v as usize + usize::from(v > v as usize as f64);
        let ([left, top], [right, bottom]) =
            ([low.x as usize, low.y as usize], [up(high.x), up(high.y)]);
        let at = |x: usize, y: usize| f64::from(self.sums[y * (self.width + 1) + x]);
        let sum = at(right, bottom) - at(left, bottom) - at(right, top) + at(left, top);
        Some(sum / ((right - left) as f64 * (bottom - top) as f64))
    }
}

/// A grid of cubic cells over the cube around a sphere; x is the fastest index.
struct Grid {
    sphere: Sphere<f64>,
    /// A cell's side.
    cell: f64,
}

impl Grid {
    fn center(&self, i: usize) -> DVec3 {
        let index =
            DVec3::new((i % GRID) as f64, (i / GRID % GRID) as f64, (i / GRID / GRID) as f64);
        self.sphere.center - self.sphere.radius + (index + 0.5) * self.cell
    }

    /// True if cell `i` is in the sphere and the views keep it.
    ///
    /// It ends at the view after which no other view can change that the cell is dropped.
    fn is_kept(&self, i: usize, views: &[View], silhouettes: &[Silhouette]) -> bool {
        let x = self.center(i);
        if (x - self.sphere.center).length() > self.sphere.radius {
            return false;
        }
        let (mut seen, mut dissent) = (0, 0);
        let least = (LEAST_SEEN * views.len() as f64).max(LEAST_VIEWS);
        let is_kept = |seen: usize, dissent: usize| {
            seen as f64 >= least && dissent as f64 <= MOST_DISSENT * seen as f64
        };
        let left = (0..views.len()).rev();
        for ((view, silhouette), left) in views.iter().zip(silhouettes).zip(left) {
            let depth = (x - view.camera.eye).dot(view.camera.forward);
            let reach = 0.5 * self.cell * view.camera.focal.max_element() / depth;
            if let Some(share) = view.camera.project(x).and_then(|u| silhouette.share(u, reach)) {
                seen += 1;
                dissent += usize::from(share < LEAST_FOREGROUND);
            }
            if !is_kept(seen + left, dissent) {
                return false;
            }
        }
        is_kept(seen, dissent)
    }
}

/// A sphere around the kept cells inside the sphere `within`, without small parts.
fn carve(views: &[View], silhouettes: &[Silhouette], within: &Sphere<f64>) -> Option<Sphere<f64>> {
    let cell = 2.0 * within.radius / GRID as f64;
    let grid = Grid { sphere: *within, cell };
    let kept: Vec<bool> =
        (0..GRID.pow(3)).into_par_iter().map(|i| grid.is_kept(i, views, silhouettes)).collect();
    let centers: Vec<DVec3> = large_parts(&kept).into_iter().map(|i| grid.center(i)).collect();
    let share = centers.len() as f64 / (kept.len() as f64 * BALL_OF_CUBE);
    if centers.is_empty() || share > MOST_KEPT {
        return None;
    }
    // A cell lies within half its diagonal of its centre.
    enclosing_sphere(&centers, 0.5 * 3f64.sqrt() * cell)
}

/// The indices of the cells in the largest connected part, and in the parts that are not much
/// smaller.
fn large_parts(kept: &[bool]) -> Vec<usize> {
    let mut visited = vec![false; kept.len()];
    let mut parts: Vec<Vec<usize>> = Vec::new();
    for seed in 0..kept.len() {
        if kept[seed] && !visited[seed] {
            parts.push(connected_part(kept, &mut visited, seed));
        }
    }
    let largest = parts.iter().map(Vec::len).max().unwrap_or(0);
    parts.retain(|part| part.len() as f64 >= LEAST_PART * largest as f64);
    parts.concat()
}

/// The kept cells connected to `seed` through faces, in breadth-first order.
fn connected_part(kept: &[bool], visited: &mut [bool], seed: usize) -> Vec<usize> {
    visited[seed] = true;
    let mut part = vec![seed];
    let mut next = 0;
    while let Some(&i) = part.get(next) {
        next += 1;
        for neighbour in neighbours(i) {
            if kept[neighbour] && !visited[neighbour] {
                visited[neighbour] = true;
                part.push(neighbour);
            }
        }
    }
    part
}

/// The cells that share a face with cell `i`: six inside the grid, fewer at its sides.
fn neighbours(i: usize) -> impl Iterator<Item = usize> {
    [1, GRID, GRID * GRID].into_iter().flat_map(move |stride| {
        let along = i / stride % GRID;
        let below = (along > 0).then(|| i - stride);
        let above = (along + 1 < GRID).then(|| i + stride);
        below.into_iter().chain(above)
    })
}

/// A sphere around all points, with `room` added to its radius. `None` without points.
///
/// The centre moves towards the farthest point, by 1/i of the distance in step i (Bădoiu and
/// Clarkson, "Smaller Core-Sets for Balls", SODA 2003). It converges to the centre of the smallest
/// enclosing sphere; the radius is exact for the centre that is returned.
pub(crate) fn enclosing_sphere(points: &[DVec3], room: f64) -> Option<Sphere<f64>> {
    let (low, high) = points
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    let mut center = (low + high) / 2.0;
    let farthest = |c: DVec3| {
        points.iter().copied().max_by(|a, b| (*a - c).length().total_cmp(&(*b - c).length()))
    };
    for step in 2..=LAST_STEP {
        center += (farthest(center)? - center) / f64::from(step);
    }
    Some(Sphere { center, radius: (farthest(center)? - center).length() + room })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_ball::{ball, cameras, photograph};

    /// The share of foreground in the box around a film position, counted pixel by pixel.
    fn counted(view: &View, is_foreground: &[bool], u: DVec2, reach: f64) -> Option<f64> {
        let [left, top] = (u - reach).floor().to_array().map(|v| v as i64);
        let [right, bottom] = (u + reach).ceil().to_array().map(|v| v as i64);
        let (width, height) = (i64::from(view.image.width), i64::from(view.image.height));
        if left < 0 || top < 0 || right > width || bottom > height {
            return None;
        }
        let rows = (top..bottom).flat_map(|y| (left..right).map(move |x| y * width + x));
        let flags: Vec<bool> = rows.map(|i| is_foreground[i as usize]).collect();
        Some(flags.iter().filter(|flag| **flag).count() as f64 / flags.len() as f64)
    }

    #[test]
    fn a_cell_is_kept_by_the_rule_over_all_views() {
        let view = |camera: render::Camera| {
            let image = photograph(&camera);
            View { name: String::new(), path: Default::default(), camera, image, mask: None }
        };
        let views: Vec<View> = cameras(24).into_iter().map(view).collect();
        // Two views of 24 show nothing but background: within the dissent.
        let flags = |(number, view): (usize, &View)| -> Vec<bool> {
            let empty = view.image.at(0, 0);
            view.image.pixels.iter().map(|pixel| *pixel != empty && number % 12 != 5).collect()
        };
        let flags: Vec<Vec<bool>> = views.iter().enumerate().map(flags).collect();
        let silhouettes: Vec<Silhouette> =
            views.iter().zip(&flags).map(|(view, own)| Silhouette::new(view, |i| own[i])).collect();
        let sphere = ball().scaled(2.0);
        let grid = Grid { sphere, cell: 2.0 * sphere.radius / GRID as f64 };
        let mut kept = 0;
        for i in (0..GRID.pow(3)).step_by(7) {
            let x = grid.center(i);
            let share = |(view, own): (&View, &Vec<bool>)| {
                let r = x - view.camera.eye;
                let reach =
                    0.5 * grid.cell * view.camera.focal.max_element() / r.dot(view.camera.forward);
                counted(view, own, view.camera.project(x)?, reach)
            };
            let shares: Vec<f64> = views.iter().zip(&flags).filter_map(share).collect();
            let dissent = shares.iter().filter(|share| **share < LEAST_FOREGROUND).count();
            let expected = x.distance(sphere.center) <= sphere.radius
                && shares.len() >= 12
                && dissent as f64 <= 0.1 * shares.len() as f64;
            assert_eq!(grid.is_kept(i, &views, &silhouettes), expected, "cell {i}");
            kept += usize::from(expected);
        }
        assert!((100..20_000).contains(&kept), "{kept}");
    }
}
