//! Pixel values as integrals along rows of the film.

use glam::{DVec2, DVec3};

use super::camera::Camera;

/// The surface along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Seen {
    /// The smooth part of the surface; 0 for the background.
    pub(crate) face: u32,
    /// The distance along the ray; infinite for the background.
    pub(crate) t: f64,
    pub(crate) radiance: DVec3,
}

/// Rows per pixel whose jumps are compared, to find rows between them where these change.
const ROWS: usize = 12;

/// Rays per pixel of a row that look for jumps.
const RAYS: usize = 12;

/// Jumps of the radiance along a row of a derivative are known to this length, in pixels and steps.
const EXACT: f64 = 1e-4;

/// Intervals of rows are halved this often at most: the part around a corner is 1e-6 pixels long.
const MOST_HALVINGS: u32 = 20;

/// Rows of a derivative where the order of jumps changes are known to this length, in pixels and
/// steps. Between these rows, a strip is integrated as if each half of it were like its end.
const EXACT_ROW: f64 = 1e-2;

/// On one face, a jump of 1/t by more than this between two rays is looked into. It is a jump by
/// 0.02 at the distance 4. Along a plane 1/t is linear on the film; t grows towards the horizon.
const JUMP: f64 = 1.25e-3;

/// Abscissas and weights of Gauss's quadrature on [0, 1] with six points.
const GAUSS: [(f64, f64); 6] = [
    (0.033_765_242_898_424, 0.085_662_246_189_585),
    (0.169_395_306_766_868, 0.180_380_786_524_069),
    (0.380_690_406_958_402, 0.233_956_967_286_346),
    (0.619_309_593_041_598, 0.233_956_967_286_346),
    (0.830_604_693_233_132, 0.180_380_786_524_069),
    (0.966_234_757_101_576, 0.085_662_246_189_585),
];

/// Calls `add` with the points and weights of a quadrature over an interval. It is accurate for
/// functions that fall to 0 or grow to infinity at its ends as √distance or 1/√distance.
fn integral([from, to]: [f64; 2], mut add: impl FnMut(f64, f64)) {
    let length = to - from;
    for (w, weight) in GAUSS {
        let density = 6.0 * w * (1.0 - w);
        add(from + length * w * w * (3.0 - 2.0 * w), weight * density * length);
    }
}

/// Whether the radiance may jump between two rays.
fn differ(a: &Seen, b: &Seen) -> bool {
    a.face != b.face || (1.0 / a.t - 1.0 / b.t).abs() > JUMP
}

/// A film, and the surfaces along its rays.
struct Film<'a> {
    camera: &'a Camera,
    see: &'a dyn Fn(DVec3) -> Seen,
    /// The error of the integral over an interval of rows where it is not divided further; infinite
    /// for outlines without corners.
    tolerance: f64,
    /// The length to which jumps along a row are known, in pixels.
    exact: f64,
    /// The length to which rows where the order of jumps changes are known, in pixels.
    exact_row: f64,
}

/// A row of the film with the places of its jumps and the faces behind them.
#[derive(Clone, Debug)]
struct Row {
    y: f64,
    jumps: Vec<(f64, u32)>,
}

impl Row {
    /// The faces in their order, with the pixels where they begin.
    fn order(&self) -> Vec<(u64, u32)> {
        self.jumps.iter().map(|(x, face)| (*x as u64, *face)).collect()
    }

    /// Positions inside all parts between neighbouring jumps.
    fn inner(&self) -> impl Iterator<Item = f64> {
        let parts = self.jumps.windows(2).map(|pair| [pair[0].0, pair[1].0]);
        parts.flat_map(|[a, b]| [0.2, 0.5, 0.8].map(|w| a + (b - a) * w))
    }

    /// A row between two others, with the jumps that a straight line between theirs would have.
    fn between(a: &Row, b: &Row, y: f64) -> Row {
        let share = (y - a.y) / (b.y - a.y);
        let pairs = a.jumps.iter().zip(&b.jumps);
        Row { y, jumps: pairs.map(|(a, b)| (a.0 + (b.0 - a.0) * share, a.1)).collect() }
    }
}

impl Film<'_> {
    fn at(&self, x: f64, y: f64) -> Seen {
        (self.see)(self.camera.direction(DVec2::new(x, y)))
    }

    /// Adds the jumps between two positions of a row.
    fn add_jumps(&self, row: &mut Row, a: (f64, Seen), b: (f64, Seen)) {
        if !differ(&a.1, &b.1) {
            return;
        }
        let middle = (a.0 + b.0) * 0.5;
        if b.0 - a.0 < self.exact {
            row.jumps.push((middle, b.1.face));
            return;
        }
        let seen = (middle, self.at(middle, row.y));
        self.add_jumps(row, a, seen);
        self.add_jumps(row, seen, b);
    }

    /// The row at y. Rays inside the narrow parts of nearby rows find those of this one.
    fn row(&self, y: f64, nearby: &[&Row]) -> Row {
        let grid = (0..=self.camera.size[0] * RAYS).map(|ray| ray as f64 / RAYS as f64);
        let mut x: Vec<f64> = grid.chain(nearby.iter().flat_map(|row| row.inner())).collect();
        x.sort_by(f64::total_cmp);
        let mut row = Row { y, jumps: Vec::new() };
        let mut last = (0.0, self.at(0.0, y));
        for x in x {
            let next = (x, self.at(x, y));
            self.add_jumps(&mut row, last, next);
            last = next;
        }
        row
    }

    /// Adds the intervals between two rows in which the order of faces does not change. Returns the
    /// second row, with parts that it had missed.
    fn add_intervals(&self, a: &Row, b: &Row, found: &mut Vec<[Row; 2]>) -> Row {
        if a.order() == b.order() {
            match found.last_mut() {
                Some(last) if last[1].y == a.y && last[1].order() == a.order() => {
                    last[1] = b.clone();
                }
                _ => found.push([a.clone(), b.clone()]),
            }
            return b.clone();
        }
        if b.y - a.y > self.exact_row {
            let middle = self.row((a.y + b.y) * 0.5, &[a, b]);
            let middle = self.add_intervals(a, &middle, found);
            return self.add_intervals(&middle, b, found);
        }
        // A row that is far from the one that it was divided from can miss a narrow part.
        let whole = self.row(a.y, &[a, b]);
        if whole.order() != a.order()
            && let Some([start, _]) = found.pop_if(|last| last[1].y == a.y)
        {
            self.add_intervals(&start, &whole, found);
        }
        self.row(b.y, &[a, b])
    }

    /// Adds `weight` times the integral of the radiance over a row to its pixels.
    fn add_row(&self, row: &Row, weight: f64, pixels: &mut [DVec3]) {
        for (x, pixel) in pixels.iter_mut().enumerate() {
            let (left, right) = (x as f64, x as f64 + 1.0);
            let inside = row.jumps.iter().map(|(s, _)| *s).filter(|s| (left..right).contains(s));
            let ends: Vec<f64> = [left].into_iter().chain(inside).chain([right]).collect();
            for pair in ends.windows(2) {
                integral([pair[0], pair[1]], |s, part| {
                    *pixel += self.at(s, row.y).radiance * (part * weight);
                });
            }
        }
    }

    /// The integral of the radiance between two rows of the same order.
    fn between(&self, [from, to]: &[Row; 2], width: usize) -> Vec<DVec3> {
        let mut pixels = vec![DVec3::ZERO; width];
        integral([from.y, to.y], |y, weight| {
            self.add_row(&self.row(y, &[&Row::between(from, to, y)]), weight, &mut pixels);
        });
        pixels
    }

    /// Adds the integral between two rows, which is about `whole`, by halves where these differ
    /// from it: an outline has a corner there, with the same face before and after.
    fn add_between(&self, ends: &[Row; 2], whole: Vec<DVec3>, left: u32, pixels: &mut [DVec3]) {
        let [from, to] = ends;
        let y = (from.y + to.y) * 0.5;
        let middle = self.row(y, &[&Row::between(from, to, y)]);
        let halves = [[from.clone(), middle.clone()], [middle, to.clone()]];
        let parts = halves.each_ref().map(|half| self.between(half, whole.len()));
        let off = |i: usize| (parts[0][i] + parts[1][i] - whole[i]).length();
        if left == 0 || (0..whole.len()).all(|i| off(i) < self.tolerance) {
            let sums = parts[0].iter().zip(&parts[1]).map(|(a, b)| *a + *b);
            pixels.iter_mut().zip(sums).for_each(|(pixel, sum)| *pixel += sum);
            return;
        }
        for (half, part) in halves.iter().zip(parts) {
            self.add_between(half, part, left - 1, pixels);
        }
    }

    /// The mean radiance of every pixel, linear RGB.
    fn image(&self) -> Vec<DVec3> {
        let [width, height] = self.camera.size;
        let mut pixels = vec![DVec3::ZERO; width * height];
        let mut last = self.row(0.0, &[]);
        for (y, pixels) in pixels.chunks_mut(width).enumerate() {
            let mut intervals = Vec::new();
            for part in 1..=ROWS {
                let next = self.row(y as f64 + part as f64 / ROWS as f64, &[&last]);
                last = self.add_intervals(&last, &next, &mut intervals);
            }
            let (mut top, bottom) = (y as f64, y as f64 + 1.0);
            for (i, [from, to]) in intervals.iter().enumerate() {
                self.add_row(from, from.y - top, pixels);
                let next = intervals.get(i + 1).map_or(bottom, |next| (to.y + next[0].y) * 0.5);
                self.add_row(to, next - to.y, pixels);
                top = next;
            }
            for interval in &intervals {
                let whole = self.between(interval, width);
                if self.tolerance.is_finite() {
                    self.add_between(interval, whole, MOST_HALVINGS, pixels);
                } else {
                    pixels.iter_mut().zip(whole).for_each(|(pixel, whole)| *pixel += whole);
                }
            }
        }
        pixels
    }
}

/// The mean radiance of every pixel: rows of pixels, linear RGB. `tolerance` is the error of the
/// integral over an interval of rows, in steps of `step`, as are the places of jumps.
fn image(camera: &Camera, tolerance: f64, step: f64, see: impl Fn(DVec3) -> Seen) -> Vec<[f64; 3]> {
    let (tolerance, exact, exact_row) = (tolerance * step, EXACT * step, EXACT_ROW * step);
    Film { camera, see: &see, tolerance, exact, exact_row }
        .image()
        .iter()
        .map(|pixel| pixel.to_array())
        .collect()
}

/// An image and its derivative by a parameter: rows of pixels, RGB.
pub(crate) struct Truth {
    pub(crate) image: Vec<[f64; 3]>,
    pub(crate) derivative: Vec<[f64; 3]>,
}

/// The mean and the central difference of the images of `see(parameter)` at ±`step`: both are exact
/// to second order. `tolerance` is that of [`image`] in steps.
pub(crate) fn truth<S: Fn(DVec3) -> Seen>(
    camera: &Camera,
    step: f64,
    tolerance: f64,
    see: impl Fn(f64) -> S,
) -> Truth {
    let [plus, minus] = [step, -step].map(|offset| image(camera, tolerance, step, see(offset)));
    let pixels = |of: &dyn Fn(f64, f64) -> f64| {
        let pairs = plus.iter().zip(&minus);
        pairs.map(|(plus, minus)| [0, 1, 2].map(|c| of(plus[c], minus[c]))).collect()
    };
    Truth {
        image: pixels(&|plus, minus| (plus + minus) / 2.0),
        derivative: pixels(&|plus, minus| (plus - minus) / (2.0 * step)),
    }
}
