//! Comparison of a patch of one photograph with its image in others, for a plane in space.

use glam::{Vec2, Vec3};

use crate::stereo::photo::Photo;

/// Half of the side of a patch, in pixels: 7 × 7 pixels, of which every second is compared.
const HALF_SIDE: i32 = 3;

/// The margin of a patch around its pixel, in pixels, with that of its structure tensor.
pub const PATCH_REACH: u32 = HALF_SIDE as u32 + 1;

/// The number of compared pixels of a patch.
const PIXELS: usize = 25;

/// The same, with pixels without weight up to a whole number of vectors.
const PADDED_PIXELS: usize = 28;

/// The difference of grey values at which a pixel has half of its weight: pixels of other
/// brightness than the middle are probably on another surface.
const GREY_SCALE: f32 = 0.15;

/// The distance from the middle at which a pixel has half of its weight, in pixels.
const PIXEL_SCALE: f32 = 3.0;

/// The least variance of grey values: a patch without a pattern can be anywhere.
const LEAST_VARIANCE: f32 = 1e-5;

/// The least share of the pattern across its main direction: 4 det/trace² of the structure tensor,
/// 0 for stripes and 1 for a pattern without a direction.
///
/// On the skull of docs/captures-compared.md, this leaves out a fifth of the depths, and all of its
/// outline.
const LEAST_ACROSS: f32 = 0.18;

/// The cost of a comparison that is not possible: that of opposite patterns.
pub(crate) const WORST: f32 = 2.0;

/// The number of neighbours whose costs count: the object can be hidden from the others.
const BEST: usize = 2;

/// The largest number of neighbours of a photograph.
pub(crate) const NEIGHBOURS: usize = 4;

/// The least and the largest area of a pixel's image in a neighbour, in pixels.
const AREAS: [f32; 2] = [0.1, 8.0];

/// The longest side of a pixel's image in a neighbour, in pixels.
const MAX_PIXEL_SIDE: f32 = 4.0;

/// A plane through a point of a pixel's ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    /// The depth along the optical axis at the middle of the pixel.
    pub(crate) depth: f32,
    /// The unit normal, towards the camera.
    pub(crate) normal: Vec3,
}

impl Plane {
    /// The depth at another film position: `ray` is that of the plane's own pixel.
    pub(crate) fn depth_at(&self, ray: Vec3, other: Vec3) -> f32 {
        self.depth * self.normal.dot(ray) / self.normal.dot(other)
    }
}

/// The pixels around the middle of a patch, with their weights.
pub(crate) struct Patch {
    middle: Vec2,
    /// Offsets from the middle, in pixels.
    x: [f32; PADDED_PIXELS],
    y: [f32; PADDED_PIXELS],
    /// Weights, with the sum 1.
    weights: [f32; PADDED_PIXELS],
    /// Weights times grey values less their mean.
    weighted: [f32; PADDED_PIXELS],
    variance: f32,
}

/// The structure tensor of a patch: sums of products of differences of grey values.
///
/// Harris and Stephens, "A Combined Corner and Edge Detector", Alvey Vision Conference 1988.
pub(crate) struct Pattern {
    xx: f32,
    xy: f32,
    yy: f32,
}

/// The pattern of the patch around a pixel; `None` if the patch with one more pixel leaves the
/// film.
pub(crate) fn pattern(photo: &Photo, x: usize, y: usize) -> Option<Pattern> {
    let reach = HALF_SIDE as usize + 1;
    if x < reach || y < reach || x + reach >= photo.width || y + reach >= photo.height {
        return None;
    }
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for y in y + 1 - reach..y + reach {
        for x in x + 1 - reach..x + reach {
            let dx = photo.grey(x + 1, y) - photo.grey(x - 1, y);
            let dy = photo.grey(x, y + 1) - photo.grey(x, y - 1);
            (xx, xy, yy) = (xx + dx * dx, xy + dx * dy, yy + dy * dy);
        }
    }
    Some(Pattern { xx, xy, yy })
}

impl Pattern {
    /// Whether it has one direction only, or is none.
    ///
    /// The outline of a smooth solid is another curve of its surface in each photograph. A
    /// comparison of photographs puts it behind the surface, and other photographs agree.
    pub(crate) fn is_ambiguous(&self) -> bool {
        4.0 * (self.xx * self.yy - self.xy * self.xy) <= LEAST_ACROSS * (self.xx + self.yy).powi(2)
    }

    /// The strength across its main direction: det/trace, about the smaller eigenvalue.
    pub(crate) fn across(&self) -> f32 {
        let trace = (self.xx + self.yy).max(f32::MIN_POSITIVE);
        (self.xx * self.yy - self.xy * self.xy) / trace
    }
}

impl Patch {
    /// The patch around a pixel; `None` if it leaves the film or has no pattern.
    pub(crate) fn of(photo: &Photo, x: usize, y: usize) -> Option<Self> {
        let half = HALF_SIDE as usize;
        if x < half || y < half || x + half >= photo.width || y + half >= photo.height {
            return None;
        }
        let center = photo.grey(x, y);
        let (mut dx, mut dy) = ([0.0; PADDED_PIXELS], [0.0; PADDED_PIXELS]);
        let (mut values, mut weights) = ([0.0; PADDED_PIXELS], [0.0; PADDED_PIXELS]);
        let places =
            (-HALF_SIDE..=HALF_SIDE).flat_map(|j| (-HALF_SIDE..=HALF_SIDE).map(move |i| (i, j)));
        for (k, (i, j)) in places.filter(|(i, j)| (i + j) % 2 == 0).take(PIXELS).enumerate() {
            let (column, row) =
                (x.wrapping_add_signed(i as isize), y.wrapping_add_signed(j as isize));
            (dx[k], dy[k], values[k]) = (i as f32, j as f32, photo.grey(column, row));
            let distance = (i * i + j * j) as f32 / (PIXEL_SCALE * PIXEL_SCALE);
            let difference = ((values[k] - center) / GREY_SCALE).powi(2);
            weights[k] = ((1.0 + distance) * (1.0 + difference)).recip();
        }
        let sum: f32 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        let mean: f32 = values.iter().zip(&weights).map(|(v, w)| v * w).sum();
        let weighted: [f32; PADDED_PIXELS] =
            std::array::from_fn(|k| weights[k] * (values[k] - mean));
        let variance: f32 = weighted.iter().zip(&values).map(|(w, v)| w * (v - mean)).sum();
        let middle = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        (variance > LEAST_VARIANCE).then_some(Patch {
            middle,
            x: dx,
            y: dy,
            weights,
            weighted,
            variance,
        })
    }

    /// The variance of the grey values.
    pub(crate) fn variance(&self) -> f32 {
        self.variance
    }

    /// The agreement of the patch with its image in another photograph, through the plane of all
    /// points `photo.eye + r / (w·r)`. `None` where the plane faces away, the image leaves the
    /// film, is too large or too small, or has no pattern.
    pub(crate) fn agreement(&self, photo: &Photo, other: &Photo, w: Vec3) -> Option<Agreement> {
        let [step_right, step_below] = photo.pixel_steps();
        let ray = photo.ray(self.middle);
        let [middle, across, down] = [ray, step_right, step_below].map(|r| other.turned(r));
        let shift = other.turned(photo.eye - other.eye);
        let (a, b, c) = (w.dot(ray), w.dot(step_right), w.dot(step_below));
        if a - HALF_SIDE as f32 * (b.abs() + c.abs()) <= 0.0 {
            return None;
        }

        // Homogeneous film positions: one plane motion for all pixels.
        let [h, h_across, h_down] = [middle + shift * a, across + shift * b, down + shift * c];
        let at = |k: usize| h + h_across * self.x[k] + h_down * self.y[k];
        let depth: [f32; PADDED_PIXELS] = std::array::from_fn(|k| at(k).z);
        if depth.iter().any(|z| *z <= f32::EPSILON) {
            return None;
        }
        let place = |h: Vec3| Vec2::from(other.on_film(h.x / h.z, h.y / h.z));
        let u: [f32; PADDED_PIXELS] = std::array::from_fn(|k| place(at(k)).x);
        let v: [f32; PADDED_PIXELS] = std::array::from_fn(|k| place(at(k)).y);
        let (right, below) = (place(h + h_across) - place(h), place(h + h_down) - place(h));
        let (area, side) = (right.perp_dot(below).abs(), right.abs().max(below.abs()));
        let fits = area > AREAS[0] && area < AREAS[1] && side.max_element() < MAX_PIXEL_SIDE;
        if !fits || !(0..PADDED_PIXELS).all(|k| other.has_around(Vec2::new(u[k], v[k]), 0.0)) {
            return None;
        }

        let (values, [du, dv]) = other.sample_with_slope(&u, &v);
        let (mut mean, mut square, mut product) = (0.0, 0.0, 0.0);
        for ((value, weight), weighted) in values.iter().zip(&self.weights).zip(&self.weighted) {
            mean += weight * value;
            square += weight * value * value;
            product += weighted * value;
        }
        let variance = square - mean * mean;
        if variance <= LEAST_VARIANCE {
            return None;
        }
        let scale = (variance * self.variance).sqrt();
        let correlation = (product / scale).clamp(-1.0, 1.0);

        let ratio = (self.variance / variance).sqrt();
        let t = other.in_pixels(shift);
        let (mut sum, mut by_right, mut by_below) = (0.0, 0.0, 0.0);
        for k in 0..PADDED_PIXELS {
            let own = self.weights[k] * (values[k] - mean) * ratio;
            let by_value = (self.weighted[k] - correlation * own) / scale;
            let [x, y] = other.off_axis([u[k], v[k]]);
            let along = (du[k] * (t.x - x * t.z) + dv[k] * (t.y - y * t.z)) * by_value / depth[k];
            sum += along;
            by_right += along * self.x[k];
            by_below += along * self.y[k];
        }
        Some(Agreement {
            correlation,
            slope: ray * sum + step_right * by_right + step_below * by_below,
        })
    }

    /// The cost of a plane: 1 less the mean of the largest normalised cross-correlations of the
    /// patch with its images in the neighbours, 0 (equal) to 2 (opposite).
    pub(crate) fn cost(&self, photo: &Photo, neighbours: &[&Photo], plane: &Plane) -> f32 {
        let ray = photo.ray(self.middle);
        let at = |offset: Vec2| {
            let ray_there = photo.ray(self.middle + offset);
            photo.eye + ray_there * plane.depth_at(ray, ray_there)
        };
        let points = [at(Vec2::ZERO), at(Vec2::X), at(Vec2::Y)];
        let mut best = [WORST; BEST];
        for neighbour in neighbours {
            let cost = self.cost_in(neighbour, points);
            if cost < best[0] {
                best = [cost, best[0]];
            } else if cost < best[1] {
                best[1] = cost;
            }
        }
        best.iter().sum::<f32>() / BEST as f32
    }

    /// The cost in one neighbour. `points` are the points of the plane in the middle of the patch,
    /// and one pixel to the right and below it: in the neighbour, the patch is a parallelogram.
    #[inline(always)]
    fn cost_in(&self, photo: &Photo, points: [Vec3; 3]) -> f32 {
        let [Some(middle), Some(right), Some(below)] = points.map(|x| photo.project(x)) else {
            return WORST;
        };
        let (right, below) = (right - middle, below - middle);
        let (area, side) = (right.perp_dot(below).abs(), right.abs().max(below.abs()));
        let reach = (right.abs() + below.abs()).max_element() * HALF_SIDE as f32;
        let fits = area > AREAS[0] && area < AREAS[1] && side.max_element() < MAX_PIXEL_SIDE;
        if !fits || !photo.has_around(middle, reach) {
            return WORST;
        }
        let (x, y) = (&self.x, &self.y);
        let u: [f32; PADDED_PIXELS] =
            std::array::from_fn(|k| middle.x + right.x * x[k] + below.x * y[k]);
        let v: [f32; PADDED_PIXELS] =
            std::array::from_fn(|k| middle.y + right.y * x[k] + below.y * y[k]);
        let values = photo.sample(&u, &v);
        // Four sums side by side: a vector.
        let (mut means, mut squares, mut products) = ([0.0; 4], [0.0; 4], [0.0; 4]);
        for k in (0..PADDED_PIXELS).step_by(4) {
            for l in 0..4 {
                let (value, own) = (values[k + l], self.weights[k + l] * values[k + l]);
                means[l] += own;
                squares[l] += own * value;
                products[l] += self.weighted[k + l] * value;
            }
        }
        let [mean, square, product] =
            [means, squares, products].map(|[a, b, c, d]: [f32; 4]| (a + b) + (c + d));
        let variance = (square - mean * mean).max(LEAST_VARIANCE);
        (1.0 - product / (variance * self.variance).sqrt()).clamp(0.0, WORST)
    }
}

/// The agreement of a patch with its image in another photograph.
pub(crate) struct Agreement {
    /// The normalised cross-correlation, −1 to 1.
    pub(crate) correlation: f32,
    /// Its derivative by the w of [`Patch::agreement`].
    pub(crate) slope: Vec3,
}
