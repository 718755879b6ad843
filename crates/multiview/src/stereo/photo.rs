//! Photographs as the search reads them: a pinhole in single precision and grey values.

use std::sync::Arc;

use film::{Film, srgb_encode};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use render::Camera;

/// The largest rounding of a film position, in pixels.
const ROUNDING: f32 = 0.01;

/// The largest grey value in display units. Brighter ones, a lamp of a photograph with a high
/// dynamic range, would leave too few steps for the others.
const BRIGHTEST: f32 = 16.0;

/// A photograph of a view.
#[derive(Clone, Debug)]
pub(crate) struct Photo {
    pub(crate) eye: Vec3,
    right: Vec3,
    down: Vec3,
    forward: Vec3,
    focal: Vec2,
    principal: Vec2,
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Grey values, row-major, in units of `unit`: half of the memory of floating point, of which
    /// large photographs have more than fits into a cache.
    grey: Arc<[u16]>,
    /// The unit of grey values, in display units.
    unit: f32,
}

impl Photo {
    pub(crate) fn new(camera: &Camera, image: &Film) -> Self {
        let grey = |p: &[f32; 3]| srgb_encode(p.iter().sum::<f32>() / 3.0);
        let values: Vec<f32> = image.pixels.par_iter().map(grey).collect();
        let brightest = values.iter().copied().fold(1.0, f32::max).min(BRIGHTEST);
        let unit = brightest / f32::from(u16::MAX);
        let grey = values.iter().map(|value| (value / unit).round() as u16).collect();
        let (width, height) = (image.width as usize, image.height as usize);
        Self::of_grey(camera, [width, height], grey, unit)
    }

    fn of_grey(camera: &Camera, [width, height]: [usize; 2], grey: Arc<[u16]>, unit: f32) -> Self {
        Photo {
            unit,
            eye: camera.eye.as_vec3(),
            right: camera.right.as_vec3(),
            down: -camera.up.as_vec3(),
            forward: camera.forward.as_vec3(),
            focal: camera.focal.as_vec2(),
            principal: camera.principal.as_vec2(),
            width,
            height,
            grey,
        }
    }

    /// The same photograph by another camera.
    pub(crate) fn with_camera(&self, camera: &Camera) -> Self {
        Self::of_grey(camera, [self.width, self.height], Arc::clone(&self.grey), self.unit)
    }

    /// The number of a pixel in row-major order.
    pub(crate) fn index(&self, x: usize, y: usize) -> usize {
        y * self.width + x
    }

    /// The grey value of a pixel.
    pub(crate) fn grey(&self, x: usize, y: usize) -> f32 {
        f32::from(self.grey[self.index(x, y)]) * self.unit
    }

    /// The vector along the ray through film position `u`, of length 1 along the optical axis.
    pub(crate) fn ray(&self, u: Vec2) -> Vec3 {
        let p = (u - self.principal) / self.focal;
        self.forward + self.right * p.x + self.down * p.y
    }

    /// The changes of [`ray`](Self::ray) over one pixel to the right, and over one pixel down.
    pub(crate) fn pixel_steps(&self) -> [Vec3; 2] {
        [self.right / self.focal.x, self.down / self.focal.y]
    }

    /// A vector in the axes of the camera: to the right, down, and along the optical axis.
    pub(crate) fn turned(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.right), v.dot(self.down), v.dot(self.forward))
    }

    /// The optical axis, a unit vector.
    pub(crate) fn axis(&self) -> Vec3 {
        self.forward
    }

    /// The film position of a point in the axes of the camera, at depth 1.
    pub(crate) fn on_film(&self, x: f32, y: f32) -> [f32; 2] {
        [self.principal.x + self.focal.x * x, self.principal.y + self.focal.y * y]
    }

    /// A vector in the axes of the camera, with its first two components in pixels at depth 1.
    pub(crate) fn in_pixels(&self, v: Vec3) -> Vec3 {
        v * self.focal.extend(1.0)
    }

    /// A film position relative to the optical axis, in pixels.
    pub(crate) fn off_axis(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        [x - self.principal.x, y - self.principal.y]
    }

    /// The film position of a point, if it is in front of the camera.
    pub(crate) fn project(&self, x: Vec3) -> Option<Vec2> {
        let r = x - self.eye;
        let depth = r.dot(self.forward);
        let along = Vec2::new(r.dot(self.right), r.dot(self.down));
        (depth > 0.0).then(|| self.principal + self.focal * along / depth)
    }

    /// The depth of a point along the optical axis.
    pub(crate) fn depth(&self, x: Vec3) -> f32 {
        (x - self.eye).dot(self.forward)
    }

    /// The pixel of a film position, if it is on the film.
    pub(crate) fn pixel(&self, u: Vec2) -> Option<[usize; 2]> {
        let inside =
            u.x >= 0.0 && u.y >= 0.0 && u.x < self.width as f32 && u.y < self.height as f32;
        inside.then(|| [(u.x as usize).min(self.width - 1), (u.y as usize).min(self.height - 1)])
    }

    /// Whether a film position and all others within `margin` pixels have neighbours on the film.
    pub(crate) fn has_around(&self, u: Vec2, margin: f32) -> bool {
        let margin = margin + 0.5 + ROUNDING;
        let [x, y] = [self.width, self.height].map(|side| side as f32 - margin);
        u.x >= margin && u.y >= margin && u.x < x && u.y < y
    }

    /// The grey values at film positions whose four nearest pixels are on the film, interpolated.
    #[inline(always)]
    pub(crate) fn sample<const N: usize>(&self, x: &[f32; N], y: &[f32; N]) -> [f32; N] {
        let Corners { values: [p, q, r, s], a, b } = self.corners(x, y);
        std::array::from_fn(|k| {
            let upper = p[k] + a[k] * (q[k] - p[k]);
            let lower = r[k] + a[k] * (s[k] - r[k]);
            (upper + b[k] * (lower - upper)) * self.unit
        })
    }

    /// The same values, and their derivatives by the film position, per pixel.
    #[inline(always)]
    pub(crate) fn sample_with_slope<const N: usize>(
        &self,
        x: &[f32; N],
        y: &[f32; N],
    ) -> ([f32; N], [[f32; N]; 2]) {
        let Corners { values: [p, q, r, s], a, b } = self.corners(x, y);
        let (mut values, mut slope) = ([0.0; N], [[0.0; N]; 2]);
        for k in 0..N {
            let (right, right_below) = (q[k] - p[k], s[k] - r[k]);
            let (upper, lower) = (p[k] + a[k] * right, r[k] + a[k] * right_below);
            values[k] = (upper + b[k] * (lower - upper)) * self.unit;
            slope[0][k] = (right + b[k] * (right_below - right)) * self.unit;
            slope[1][k] = (lower - upper) * self.unit;
        }
        (values, slope)
    }

    /// The four pixels around each film position. One loop for the places and one for the pixels:
    /// the first is vector code, and so is the interpolation after both.
    #[inline(always)]
    fn corners<const N: usize>(&self, x: &[f32; N], y: &[f32; N]) -> Corners<N> {
        let (mut at, mut a, mut b) = ([0; N], [0.0; N], [0.0; N]);
        for k in 0..N {
            let (x, y) = (x[k] - 0.5, y[k] - 0.5);
            let (i, j) = (x as i32, y as i32);
            (a[k], b[k]) = (x - i as f32, y - j as f32);
            at[k] = j * self.width as i32 + i;
        }
        let mut values = [[0; N]; 4];
        for k in 0..N {
            let at = at[k] as usize;
            let (upper, lower) = (&self.grey[at..at + 2], &self.grey[at + self.width..][..2]);
            (values[0][k], values[1][k]) = (upper[0], upper[1]);
            (values[2][k], values[3][k]) = (lower[0], lower[1]);
        }
        Corners { values: values.map(|values| values.map(f32::from)), a, b }
    }
}

/// The four pixels around film positions.
struct Corners<const N: usize> {
    /// Their values in units of a photograph: upper left, upper right, lower left, lower right.
    values: [[f32; N]; 4],
    /// The place between the left and the right pixels, 0 to 1.
    a: [f32; N],
    /// The place between the upper and the lower pixels, 0 to 1.
    b: [f32; N],
}
