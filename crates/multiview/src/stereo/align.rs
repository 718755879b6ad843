//! Alignment of a patch of one photograph with another photograph, to a part of a pixel.
//!
//! Lucas and Kanade, "An Iterative Image Registration Technique with an Application to Stereo
//! Vision", IJCAI 1981, with an affine map, a gain and an offset of the grey values.

use glam::Vec2;

use crate::stereo::photo::Photo;

/// Half of the side of a patch, in pixels.
pub const HALF_PATCH: u32 = 7;

/// The same, for places before and behind the middle.
const HALF: i32 = HALF_PATCH as i32;

/// The side of a patch, in pixels.
const SIDE: usize = 2 * HALF as usize + 1;

/// The unknowns of a step: the place, both columns of the map, gain and offset.
const UNKNOWNS: usize = 8;

/// Steps of an alignment, at most.
const MAX_ALIGNMENT_STEPS: usize = 15;

/// A step that moves the patch by less than this is the last, in pixels.
const SMALL: f32 = 0.005;

/// The largest motion of the middle from where it is expected, in pixels.
const MAX_MOTION: f32 = 4.0;

/// The least correlation of aligned patches.
const LEAST_CORRELATION: f64 = 0.9;

/// The image of a patch: a parallelogram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Parallelogram {
    /// The place of the patch's middle, in pixels.
    pub(crate) middle: Vec2,
    /// The image of the step from a pixel to the one right of it.
    pub(crate) right: Vec2,
    /// The image of the step to the pixel below.
    pub(crate) below: Vec2,
}

impl Parallelogram {
    /// A patch as it is.
    pub(crate) fn upright(middle: Vec2) -> Self {
        Parallelogram { middle, right: Vec2::X, below: Vec2::Y }
    }

    /// The image, in the other direction, of the patch around this one's middle: `middle` is that
    /// of the patch whose image this is. `None` if this one has no area.
    pub(crate) fn inverse(&self, middle: Vec2) -> Option<Self> {
        let Parallelogram { right, below, .. } = *self;
        let area = right.perp_dot(below);
        (area.abs() > 1e-3).then(|| Parallelogram {
            middle,
            right: Vec2::new(below.y, -right.y) / area,
            below: Vec2::new(-below.x, right.x) / area,
        })
    }

    /// The places of the row `j` of the patch, moved by `shift`.
    fn row(&self, j: i32, shift: Vec2) -> [[f32; SIDE]; 2] {
        let start = self.middle + shift + self.below * j as f32;
        let at = |i: usize| start + self.right * (i as i32 - HALF) as f32;
        [std::array::from_fn(|i| at(i).x), std::array::from_fn(|i| at(i).y)]
    }

    /// The grey values of the row `j`, moved by `shift`.
    fn values(&self, photo: &Photo, j: i32, shift: Vec2) -> [f32; SIDE] {
        let [x, y] = self.row(j, shift);
        photo.sample(&x, &y)
    }

    /// Whether the patch and the pixels beside it are on the film.
    fn is_on(&self, photo: &Photo) -> bool {
        let reach = (self.right.abs() + self.below.abs()).max_element() * HALF as f32;
        photo.has_around(self.middle, reach + 1.0)
    }
}

/// Moves `start`, the expected image of the patch around `middle` of the photograph `from` in the
/// photograph `to`, to where it looks like the patch. `None` if there is no such place.
pub(crate) fn align(
    from: &Photo,
    middle: Vec2,
    to: &Photo,
    start: Parallelogram,
) -> Option<Parallelogram> {
    let patch = Parallelogram::upright(middle);
    if !patch.is_on(from) {
        return None;
    }
    let rows: Vec<[f32; SIDE]> =
        (-HALF..=HALF).map(|j| patch.values(from, j, Vec2::ZERO)).collect();
    let mut image = start;
    let mut gain = 1.0;
    for _ in 0..MAX_ALIGNMENT_STEPS {
        let is_near = image.middle.distance(start.middle) <= MAX_MOTION;
        if !is_near || !image.is_on(to) {
            return None;
        }
        let step = normal_equations(&rows, to, &image, gain).solved()?;
        let [x, y, xi, xj, yi, yj, more, _] = step.map(|v| v as f32);
        let motion = Vec2::new(x, y);
        image.middle += motion;
        image.right += Vec2::new(xi, yi);
        image.below += Vec2::new(xj, yj);
        gain += more;
        if motion.length() < SMALL {
            let fits = image.is_on(to) && image.middle.distance(start.middle) <= MAX_MOTION;
            return (fits && correlation(&rows, to, &image) >= LEAST_CORRELATION).then_some(image);
        }
    }
    None
}

/// The normal equations of a step.
#[derive(Default)]
struct Normal {
    matrix: [[f64; UNKNOWNS]; UNKNOWNS],
    right: [f64; UNKNOWNS],
}

/// The normal equations of a step for Σ (gain · image + offset − patch)². The offset is found anew
/// in each step.
fn normal_equations(rows: &[[f32; SIDE]], to: &Photo, image: &Parallelogram, gain: f32) -> Normal {
    let mut out = Normal::default();
    for (j, row) in (-HALF..=HALF).zip(rows) {
        let values = image.values(to, j, Vec2::ZERO);
        let shifted = |shift| image.values(to, j, shift);
        let [left, right, up, down] = [-Vec2::X, Vec2::X, -Vec2::Y, Vec2::Y].map(shifted);
        for k in 0..SIDE {
            let i = (k as i32 - HALF) as f32;
            let (dx, dy) = (0.5 * gain * (right[k] - left[k]), 0.5 * gain * (down[k] - up[k]));
            let j = j as f32;
            let slope = [dx, dy, dx * i, dx * j, dy * i, dy * j, values[k], 1.0].map(f64::from);
            let residual = f64::from(row[k] - gain * values[k]);
            for a in 0..UNKNOWNS {
                out.right[a] += slope[a] * residual;
                for b in 0..=a {
                    out.matrix[a][b] += slope[a] * slope[b];
                }
            }
        }
    }
    out
}

impl Normal {
    /// The solution by Cholesky's method; `None` if the matrix is not positive definite.
    fn solved(self) -> Option<[f64; UNKNOWNS]> {
        let Normal { matrix: mut l, right: mut x } = self;
        for a in 0..UNKNOWNS {
            for b in 0..=a {
                let inner: f64 = (0..b).map(|k| l[a][k] * l[b][k]).sum();
                let left = l[a][b] - inner;
                if a == b && left <= 1e-9 * l[a][a].max(1e-9) {
                    return None;
                }
                l[a][b] = if a == b { left.sqrt() } else { left / l[b][b] };
            }
        }
        for a in 0..UNKNOWNS {
            let inner: f64 = (0..a).map(|k| l[a][k] * x[k]).sum();
            x[a] = (x[a] - inner) / l[a][a];
        }
        for a in (0..UNKNOWNS).rev() {
            let inner: f64 = (a + 1..UNKNOWNS).map(|k| l[k][a] * x[k]).sum();
            x[a] = (x[a] - inner) / l[a][a];
        }
        Some(x)
    }
}

/// The correlation of a patch with its image.
fn correlation(rows: &[[f32; SIDE]], to: &Photo, image: &Parallelogram) -> f64 {
    let mut pairs = Vec::with_capacity(SIDE * SIDE);
    for (j, row) in (-HALF..=HALF).zip(rows) {
        let values = image.values(to, j, Vec2::ZERO);
        pairs.extend(row.iter().zip(values).map(|(a, b)| (f64::from(*a), f64::from(b))));
    }
    let n = pairs.len() as f64;
    let (a, b) = pairs.iter().fold((0.0, 0.0), |(a, b), pair| (a + pair.0 / n, b + pair.1 / n));
    let sums = pairs.iter().map(|pair| (pair.0 - a, pair.1 - b));
    let (aa, ab, bb) =
        sums.fold((0.0, 0.0, 0.0), |(aa, ab, bb), (a, b)| (aa + a * a, ab + a * b, bb + b * b));
    ab / (aa * bb).sqrt().max(1e-12)
}

#[cfg(test)]
mod tests {
    use film::Film;
    use glam::{DVec2, DVec3};
    use render::Camera;

    use super::*;

    /// A photograph of a smooth pattern, seen through an affine map of the film, with a gain.
    fn photo(map: impl Fn(Vec2) -> Vec2, gain: f32) -> Photo {
        let (focal, middle) = (DVec2::splat(64.0), DVec2::splat(32.0));
        let camera =
            Camera::look_at(64, 64, focal, middle, DVec3::Z * 3.0, DVec3::ZERO, DVec3::Y).unwrap();
        let pixel = |i: u32| {
            let u = map(Vec2::new((i % 64) as f32 + 0.5, (i / 64) as f32 + 0.5));
            let value = 0.5
                + 0.2 * (0.5 * u.x).sin() * (0.4 * u.y + 0.3).cos()
                + 0.1 * (0.23 * u.x + 0.31 * u.y).sin();
            film::srgb_decode(gain * value)
        };
        let values: Vec<f32> = (0..64 * 64).map(pixel).collect();
        Photo::new(&camera, &Film::grey(64, 64, values))
    }

    #[test]
    fn a_patch_is_found_to_a_fraction_of_a_pixel() {
        let from = photo(|u| u, 1.0);
        // A point u of `to` shows the point 31 + M (u − 33) of `from`.
        let to = photo(
            |u| {
                let v = u - Vec2::new(33.3, 32.6);
                Vec2::new(31.0, 30.0) + Vec2::new(1.1 * v.x + 0.1 * v.y, 0.95 * v.y - 0.05 * v.x)
            },
            0.8,
        );
        let middle = Vec2::new(31.0, 30.0);
        let start = Parallelogram::upright(Vec2::new(34.5, 31.5));
        let found = align(&from, middle, &to, start).unwrap();
        assert!(found.middle.distance(Vec2::new(33.3, 32.6)) < 0.03, "{found:?}");
        // And back.
        let back = align(&to, found.middle, &from, found.inverse(middle).unwrap()).unwrap();
        assert!(back.middle.distance(middle) < 0.03, "{back:?}");
        let inverse = found.inverse(middle).unwrap();
        assert!(inverse.right.distance(Vec2::new(1.1, -0.05)) < 0.02, "{inverse:?}");
    }

    #[test]
    fn other_patterns_and_places_beside_the_film_are_not_found() {
        let (from, same) = (photo(|u| u, 1.0), photo(|u| u, 1.0));
        let other = photo(|u| Vec2::new(1.7 * u.y, -2.3 * u.x), 1.0);
        let (middle, at) = (Vec2::new(30.0, 30.0), Parallelogram::upright);
        assert!(align(&from, middle, &same, at(middle)).is_some());
        assert_eq!(align(&from, middle, &other, at(middle)), None);
        assert_eq!(align(&from, middle, &same, at(Vec2::new(5.0, 30.0))), None);
        assert_eq!(align(&from, Vec2::new(3.0, 30.0), &same, at(middle)), None);
        let flat = photo(|_| Vec2::ZERO, 1.0);
        assert_eq!(align(&flat, middle, &flat, at(middle)), None);
    }
}
