//! A term that guides a field by known distances.

use field::{Field, Sphere};
use glam::{DVec2, DVec3, Vec3};
use random::Stream;
use render::Camera;

use crate::stereo::depth::DepthMap;

/// The depth maps of views whose cameras may have films of another size.
#[derive(Clone, Copy, Debug)]
pub struct Guide<'a> {
    /// A map for each view.
    pub maps: &'a [DepthMap],
    /// Pixels of a map for each pixel of the cameras' films.
    pub scale: f64,
}

impl Guide<'_> {
    /// The known distance at a film position of a view, in pixels of the camera's film.
    pub fn distance(&self, view: usize, u: DVec2) -> Option<f32> {
        self.maps[view].at(u * self.scale)
    }

    /// Whether a depth map has its surface at the point x, within a distance `near`, in world
    /// units. `cameras` are those of the views.
    pub fn is_surface(&self, cameras: &[Camera], x: DVec3, near: f64) -> bool {
        cameras.iter().enumerate().any(|(view, camera)| {
            let known = camera.project_onto_film(x).and_then(|u| self.distance(view, u));
            let distance = (x - camera.eye).length();
            known.is_some_and(|known| (f64::from(known) - distance).abs() < near)
        })
    }
}

/// The part of a ray in front of the surface, in bounding radii, that is not asked to be free: the
/// errors of distances.
const MARGIN: f32 = 0.03;

/// Points at random places of the free part of a ray.
const FREE: usize = 2;

/// The value of f at a known surface, in bounding radii, from which on the term is linear.
const SOFTNESS: f32 = 0.01;

/// A ray that meets the bounding ball, with the known distance of the surface that it shows.
#[derive(Clone, Copy, Debug)]
pub struct GuidedRay {
    /// The origin, in world units.
    pub origin: Vec3,
    /// The unit direction.
    pub direction: Vec3,
    /// The distance of the surface, in world units; it can be behind the ball.
    pub distance: f32,
    /// The weight of the ray's term.
    pub weight: f32,
}

/// A point of the term.
struct Point {
    x: Vec3,
    weight: f32,
    is_free: bool,
}

impl Point {
    /// The term for f in bounding radii, and its derivative.
    fn term(&self, f: f32) -> (f32, f32) {
        let (value, slope) = if self.is_free {
            ((-f).max(0.0), if f < 0.0 { -1.0 } else { 0.0 })
        } else {
            let root = f.hypot(SOFTNESS);
            (root - SOFTNESS, f / root)
        };
        (value * self.weight, slope * self.weight)
    }
}

/// The points of all rays. `stream` places those of free parts.
fn points(ball: &Sphere<f32>, rays: &[GuidedRay], stream: Stream) -> Vec<Point> {
    let mut out = Vec::new();
    for (ray, i) in rays.iter().zip(0..) {
        let Some((near, far)) = ball.clip(ray.origin, ray.direction) else { continue };
        let at = |t: f32| ray.origin + ray.direction * t;
        let end = (ray.distance - MARGIN * ball.radius).min(far);
        if end > near {
            let place =
                |k: usize| (k as f32 + stream.at(i).at(k as u64).unit() as f32) / FREE as f32;
            let places = (0..FREE).map(place).chain([1.0]);
            let weight = 0.5 * ray.weight;
            out.extend(places.map(|p| Point {
                x: at(near + (end - near) * p),
                weight,
                is_free: true,
            }));
        }
        if ray.distance > near && ray.distance < far {
            out.push(Point { x: at(ray.distance), weight: ray.weight, is_free: false });
        }
    }
    out
}

/// The coefficients α of f at points x, of the derivative of a term that is small where the field
/// agrees with known distances: space before them is free (f > 0), and f is 0 there.
///
/// For each ray, the term is its weight times ½ Σ max(0, −f) at three points of the free part, and
/// √(f² + s²) − s with s = 0.01 at the surface; f is in bounding radii.
pub fn guide(
    field: &dyn Field<f32>,
    ball: &Sphere<f32>,
    rays: &[GuidedRay],
    stream: Stream,
) -> Vec<(Vec3, f32)> {
    let points = points(ball, rays, stream);
    let x: Vec<Vec3> = points.iter().map(|point| point.x).collect();
    let mut f = vec![0.0; x.len()];
    field.value(&x, &mut f);
    let of = |(point, f): (&Point, &f32)| (point.x, point.term(f / ball.radius).1 / ball.radius);
    points.iter().zip(&f).map(of).filter(|(_, alpha)| *alpha != 0.0).collect()
}

#[cfg(test)]
mod tests {
    use field::Shape;
    use random::Name;

    use super::*;

    const BALL: Sphere<f32> = Sphere { center: Vec3::ZERO, radius: 2.0 };

    fn ray(x: f32, distance: f32) -> GuidedRay {
        let (origin, direction) = (Vec3::new(x, 0.0, -5.0), Vec3::Z);
        GuidedRay { origin, direction, distance, weight: 0.7 }
    }

    fn stream() -> Stream {
        Stream::of_seed(5).named(Name::other("places"))
    }

    fn total(field: &dyn Field<f32>, rays: &[GuidedRay]) -> f64 {
        let points = points(&BALL, rays, stream());
        let value = |point: &Point| {
            let mut f = [0.0];
            field.value(&[point.x], &mut f);
            f64::from(point.term(f[0] / BALL.radius).0)
        };
        points.iter().map(value).sum()
    }

    #[test]
    fn the_coefficients_are_the_derivative_of_the_term() {
        // Too near, too far, behind the ball, beside the ball of rays.
        let rays = [ray(0.1, 4.5), ray(0.3, 3.3), ray(0.5, 9.0), ray(2.5, 4.0)];
        let of = |radius: f64| Shape::<f32>::sphere([0.0; 3], radius);
        // All f grow by h where the ball shrinks by h.
        let h = 1e-3;
        let difference = (total(&of(1.0 - h), &rays) - total(&of(1.0 + h), &rays)) / (2.0 * h);
        let along: f64 =
            guide(&of(1.0), &BALL, &rays, stream()).iter().map(|(_, a)| f64::from(*a)).sum();
        assert!((along - difference).abs() < 1e-3 && along.abs() > 0.1, "{along}, {difference}");
    }

    #[test]
    fn a_field_with_the_known_distances_stays() {
        let ball = Shape::<f32>::sphere([0.0; 3], 1.0);
        assert!(
            guide(&ball, &BALL, &[ray(0.0, 4.0)], stream()).iter().all(|(_, a)| a.abs() < 1e-3)
        );
        // A surface in front of the known distance moves back, a surface behind it moves forward.
        let sum = |distance: f32| -> f32 {
            guide(&ball, &BALL, &[ray(0.0, distance)], stream()).iter().map(|(_, a)| a).sum()
        };
        assert!(sum(4.5) < 0.0 && sum(3.5) > 0.0);
    }

    #[test]
    fn a_point_on_a_known_depth_is_a_surface() {
        let (focal, middle) = (DVec2::splat(10.0), DVec2::splat(4.0));
        let eye = DVec3::new(0.0, 0.0, 5.0);
        let camera = Camera::look_at(8, 8, focal, middle, eye, DVec3::ZERO, DVec3::Y).unwrap();
        // Half of the camera's size. The upper left pixel of the four in the middle is known.
        let mut map = DepthMap { width: 4, distances: vec![0.0; 16] };
        map.distances[5] = 4.0;
        let guide = Guide { maps: &[map], scale: 0.5 };
        let is_surface = |x, y, z| guide.is_surface(&[camera], DVec3::new(x, y, z), 0.1);
        assert!(is_surface(-0.1, 0.1, 1.0) && is_surface(-0.1, 0.1, 1.05));
        // Before and behind it, at a pixel without a depth, and off the film.
        assert!(!is_surface(-0.1, 0.1, 1.2) && !is_surface(-0.1, 0.1, 0.8));
        assert!(!is_surface(0.1, 0.1, 1.0) && !is_surface(-9.0, 0.1, 1.0));
    }
}
