//! Whether the background is far away: photographs show it alike along equal directions.

use field::Sphere;
use film::srgb_encode;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use render::Camera;

use dataset::View;

/// Photographs are compared at this size at most, in pixels along the longer side: smaller errors
/// of poses than a pixel of it do not matter.
const SIDE: u32 = 256;

/// The number of other views with which a view is compared: those of the nearest optical axes that
/// [see a near background move](Photo::tells_distance_from).
const NEIGHBOURS: usize = 8;

/// A background up to this distance from the eye, in radii of the sphere, must move between two
/// compared photographs: else neighbouring frames of a video would find it far away.
const NEAR: f64 = 20.0;

/// Half of a patch's side, in pixels, without the middle.
const HALF: i32 = 3;

/// The number of pixels of a patch.
const PATCH: usize = ((2 * HALF + 1) * (2 * HALF + 1)) as usize;

/// The distance of patches, in pixels.
const STEP: usize = 4;

/// The least standard deviation of a patch, in display units. A patch without a pattern is alike
/// at any distance.
const LEAST_DEVIATION: f64 = 0.01;

/// The least normalised cross-correlation of patches that are alike. The median is 0.998 before a
/// panorama, 0.13 before another noise in each photograph, and 0.00 before a table.
const CORRELATED: f64 = 0.8;

/// The least number of comparisons. Views all around an object share few directions.
const LEAST_COMPARISONS: usize = 64;

/// The share of the patches of the background, 0 to 1, that two photographs show alike along equal
/// directions; 0 with fewer than 64 comparisons. Only patches with a pattern count.
///
/// A pixel is compared with that of another view whose ray has the same direction, if both rays
/// miss the sphere. A background up to 20 radii from the eyes would move by a patch between the
/// two.
pub(crate) fn share_of_distant(views: &[View], sphere: &Sphere<f64>) -> f32 {
    let photos: Vec<Photo> = views.par_iter().map(|view| Photo::new(view, sphere)).collect();
    let counts: Vec<Counts> =
        photos.par_iter().map(|photo| photo.compare(&photos, sphere.radius)).collect();
    let compared: usize = counts.iter().map(|counts| counts.compared).sum();
    let alike: usize = counts.iter().map(|counts| counts.alike).sum();
    if compared < LEAST_COMPARISONS { 0.0 } else { alike as f32 / compared as f32 }
}

/// Numbers of patches.
#[derive(Default)]
struct Counts {
    compared: usize,
    alike: usize,
}

/// A reduced photograph.
struct Photo {
    eye: DVec3,
    /// The camera, with its eye at the origin.
    camera: Camera,
    /// Grey values in display units, row-major.
    grey: Vec<f64>,
    /// Whether each pixel shows the background: it is used, and its ray misses the sphere.
    is_background: Vec<bool>,
}

impl Photo {
    fn new(view: &View, sphere: &Sphere<f64>) -> Self {
        let (width, height) = (view.image.width, view.image.height);
        let n = width.max(height).div_ceil(SIDE);
        let image = view.image.downscaled(n);
        let camera = view.camera.reduced(n, image.width, image.height);
        let grey = |p: &[f32; 3]| f64::from(srgb_encode(p.iter().sum::<f32>() / 3.0));
        // All pixels of a block must be used.
        let is_used = |x: u32, y: u32| {
            let [mut columns, rows] =
                [(x, width), (y, height)].map(|(i, side)| i * n..(i * n + n).min(side));
            columns.all(|x| rows.clone().all(|y| view.is_used((y * width + x) as usize)))
        };
        let places = (0..image.height).flat_map(|y| (0..image.width).map(move |x| (x, y)));
        let is_background = places.map(|(x, y)| {
            let direction = camera.direction(middle(x as usize, y as usize));
            is_used(x, y) && sphere.clip(camera.eye, direction).is_none()
        });
        let is_background = is_background.collect();
        let grey = image.pixels.iter().map(grey).collect();
        let (eye, camera) = (camera.eye, camera.about(camera.eye));
        Photo { eye, camera, grey, is_background }
    }

    fn size(&self) -> [usize; 2] {
        [self.camera.width as usize, self.camera.height as usize]
    }

    /// The interpolated grey value at a film position; `None` if one of the four pixels around it
    /// does not show the background or is not on the film.
    fn sample(&self, u: DVec2) -> Option<f64> {
        let [width, height] = self.size();
        let p = u - 0.5;
        let whole = p.floor();
        let is_inside = whole.cmpge(DVec2::ZERO).all()
            && whole.cmplt(DVec2::new(width as f64 - 1.0, height as f64 - 1.0)).all();
        if !is_inside {
            return None;
        }
        let (at, part) = (whole.y as usize * width + whole.x as usize, p - whole);
        let corners = [at, at + 1, at + width, at + width + 1];
        if !corners.iter().all(|i| self.is_background[*i]) {
            return None;
        }
        let [a, b, c, d] = corners.map(|i| self.grey[i]);
        let (upper, lower) = (a + part.x * (b - a), c + part.x * (d - c));
        Some(upper + part.y * (lower - upper))
    }

    /// The grey values and the directions of the patch around a pixel; `None` if one of its pixels
    /// does not show the background.
    fn patch(&self, x: usize, y: usize) -> Option<[(f64, DVec3); PATCH]> {
        let mut out = [(0.0, DVec3::ZERO); PATCH];
        let offsets = (-HALF..=HALF).flat_map(|y| (-HALF..=HALF).map(move |x| (x, y)));
        for (pixel, (dx, dy)) in out.iter_mut().zip(offsets) {
            let u = middle(x, y) + DVec2::new(f64::from(dx), f64::from(dy));
            *pixel = (self.sample(u)?, self.camera.direction(u));
        }
        Some(out)
    }

    /// The normalised cross-correlation of a patch with the pixels of the same directions; `None`
    /// if one of them does not show the background, or the patch has no pattern.
    fn correlation(&self, patch: &[(f64, DVec3); PATCH]) -> Option<f64> {
        let mut pairs = [(0.0, 0.0); PATCH];
        for (pair, (value, direction)) in pairs.iter_mut().zip(patch) {
            *pair = (*value, self.sample(self.camera.project(*direction)?)?);
        }
        let count = PATCH as f64;
        let (a, b) = pairs.iter().fold((0.0, 0.0), |sum, pair| (sum.0 + pair.0, sum.1 + pair.1));
        let (mut aa, mut ab, mut bb) = (0.0, 0.0, 0.0);
        for pair in &pairs {
            let (x, y) = (pair.0 - a / count, pair.1 - b / count);
            (aa, ab, bb) = (aa + x * x, ab + x * y, bb + y * y);
        }
        let has_pattern = aa > count * LEAST_DEVIATION * LEAST_DEVIATION;
        has_pattern.then(|| if bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 })
    }

    /// Whether a background at the distance [`NEAR`] moves by a patch between this photograph and
    /// another. `radius` is that of the sphere.
    fn tells_distance_from(&self, other: &Photo, radius: f64) -> bool {
        let baseline = (other.eye - self.eye).reject_from_normalized(self.camera.forward).length();
        let pixels = self.camera.focal.max_element() * baseline / (NEAR * radius);
        pixels >= f64::from(2 * HALF + 1)
    }

    /// Compares the patches of this photograph with those of its neighbours. `radius` is that of
    /// the sphere.
    fn compare(&self, photos: &[Photo], radius: f64) -> Counts {
        let others = photos.iter().filter(|other| self.tells_distance_from(other, radius));
        let mut others: Vec<&Photo> = others.collect();
        let closeness = |other: &Photo| other.camera.forward.dot(self.camera.forward);
        others.sort_by(|a, b| closeness(b).total_cmp(&closeness(a)));
        others.truncate(NEIGHBOURS);
        let mut counts = Counts::default();
        let [width, height] = self.size();
        let rows = (0..height).step_by(STEP);
        let places = rows.flat_map(|y| (0..width).step_by(STEP).map(move |x| (x, y)));
        for patch in places.filter_map(|(x, y)| self.patch(x, y)) {
            for correlation in others.iter().filter_map(|other| other.correlation(&patch)) {
                counts.compared += 1;
                counts.alike += usize::from(correlation >= CORRELATED);
            }
        }
        counts
    }
}

/// The middle of a pixel, as a film position.
fn middle(x: usize, y: usize) -> DVec2 {
    DVec2::new(x as f64, y as f64) + 0.5
}

#[cfg(test)]
mod tests {
    use film::Film;

    use super::*;

    const SIDE: u32 = 128;

    const SPHERE: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 1.0 };

    /// The camera at an angle, in radians, on a circle around the sphere.
    fn camera(angle: f64) -> Camera {
        let (focal, middle) = (DVec2::splat(80.0), DVec2::splat(64.0));
        let eye = DVec3::new(angle.cos(), angle.sin(), 0.3) * 3.0;
        Camera::look_at(SIDE, SIDE, focal, middle, eye, DVec3::ZERO, DVec3::Z).unwrap()
    }

    /// The share in front of a background that has the grey value `shown`, by the number of the
    /// view, the eye and the direction of the ray. There are 12 views, `step` radians apart.
    fn share_of(step: f64, shown: &dyn Fn(usize, DVec3, DVec3) -> f64) -> f32 {
        let view = |number: usize| {
            let camera = camera(step * number as f64);
            let pixel = |i: usize| camera.direction(middle(i % SIDE as usize, i / SIDE as usize));
            let pixels =
                (0..(SIDE * SIDE) as usize).map(|i| shown(number, camera.eye, pixel(i)) as f32);
            let image = Film::grey(SIDE, SIDE, pixels);
            View { name: String::new(), path: Default::default(), camera, image, mask: None }
        };
        let views: Vec<View> = (0..12).map(view).collect();
        share_of_distant(&views, &SPHERE)
    }

    fn share(shown: &dyn Fn(usize, DVec3, DVec3) -> f64) -> f32 {
        share_of(0.5, shown)
    }

    /// The grey value of a direction on a ball around all.
    fn on_ball(radius: f64, eye: DVec3, direction: DVec3) -> f64 {
        let (_, far) = Sphere { radius, ..SPHERE }.clip(eye, direction).unwrap();
        pattern((eye + direction * far) / radius)
    }

    fn pattern(x: DVec3) -> f64 {
        0.5 + 0.2 * (13.0 * x.x + 2.0).sin() * (11.0 * x.y).cos() + 0.1 * (17.0 * x.z).sin()
    }

    #[test]
    fn a_panorama_is_distant_and_a_room_is_not() {
        let panorama = share(&|_, _, direction| pattern(direction));
        // Another exposure of each photograph.
        let exposed =
            share(&|number, _, direction| (0.6 + 0.1 * number as f64) * pattern(direction));
        let room = share(&|_, eye, direction| on_ball(5.0, eye, direction));
        let far = share(&|_, eye, direction| on_ball(500.0, eye, direction));
        println!("{panorama} {exposed} {room} {far}");
        assert!(panorama > 0.99 && exposed > 0.99 && far > 0.99, "{panorama}, {exposed}, {far}");
        assert!(room < 0.3, "{room}");
    }

    #[test]
    fn frames_of_a_video_do_not_tell_the_distance() {
        assert_eq!(share_of(0.01, &|_, eye, direction| on_ball(5.0, eye, direction)), 0.0);
        assert_eq!(share_of(0.0, &|_, _, direction| pattern(direction)), 0.0);
    }

    #[test]
    fn another_background_in_each_view_is_not_distant() {
        let found = share(&|number, _, direction| pattern(direction + number as f64));
        assert!(found < 0.5, "{found}");
    }

    #[test]
    fn nothing_is_known_without_a_pattern_or_without_background() {
        assert_eq!(share(&|_, _, _| 0.5), 0.0);
        assert_eq!(share_of_distant(&[], &SPHERE), 0.0);
        let view = |number: usize| {
            let camera = camera(0.5 * number as f64);
            let image = Film::grey(SIDE, SIDE, (0..SIDE * SIDE).map(|i| (i % 7) as f32 / 7.0));
            View { name: String::new(), path: Default::default(), camera, image, mask: None }
        };
        let views: Vec<View> = (0..12).map(view).collect();
        assert_eq!(share_of_distant(&views, &SPHERE.scaled(2.9)), 0.0);
    }
}
