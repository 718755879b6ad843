//! A sphere around the points on the scene's surfaces that came with the cameras.

use field::Sphere;
use glam::DVec3;

use crate::carve::enclosing_sphere;
use dataset::View;
use random::{Name, Stream};

/// The least number of surface points from which a sphere is estimated.
const LEAST_POINTS: usize = 50;

/// The share of the surface points that the sphere contains. The others can be mismatches, or a
/// distant corner of a table.
const CONTAINED: f64 = 0.98;

/// The least radius of a sphere around surface points, in radii of the sphere that the median
/// camera sees whole.
const LEAST_OF_FRAMED: f64 = 0.8;

/// The largest radius of a cloud of points that lies on the object, in radii of the sphere that the
/// median camera sees whole. Points of a room lie farther away.
const MOST_OF_FRAMED: f64 = 1.5;

/// Planes that are tried.
const PLANES: u64 = 500;

/// Points by which planes are compared, at most.
const COMPARED: usize = 2000;

/// The largest distance of a point from a plane that it lies on, in radii of the sphere that the
/// median camera sees whole.
const ON_PLANE: f64 = 0.03;

/// The least distance of a point that stands out of a plane, in the same radii.
const BEFORE_PLANE: f64 = 0.08;

/// The least share of the points on a plane that counts as one.
const LEAST_ON_PLANE: f64 = 0.25;

/// The least share of the points that stand out of it.
const LEAST_BEFORE: f64 = 0.05;

const PLANE: Name = Name::new("points through which a plane is tried", 35);

/// The least share of the views of a point whose masks show it, for a point on the object.
const LEAST_SHOWN: f64 = 0.8;

/// The least share of all views that must have such a point on their film. Few masks could show a
/// point before or behind the object.
const LEAST_SEEN: f64 = 0.5;

/// The points that lie on the object by the masks: nearly all views with the point on their film
/// show it as the object. One wrong mask, which breaks a visual hull, leaves them.
pub(crate) fn shown_by_masks(points: &[DVec3], views: &[View]) -> Vec<DVec3> {
    let is_shown = |point: &&DVec3| {
        let (mut shown, mut all) = (0usize, 0usize);
        for view in views {
            let (Some(u), Some(mask)) = (view.camera.project(**point), view.coverage()) else {
                continue;
            };
            let [width, height] = [view.image.width, view.image.height].map(f64::from);
            if u.x >= 0.0 && u.y >= 0.0 && u.x < width && u.y < height {
                all += 1;
                shown += usize::from(mask[u.y as usize * width as usize + u.x as usize] >= 0.5);
            }
        }
        all as f64 >= LEAST_SEEN * views.len() as f64 && shown as f64 >= LEAST_SHOWN * all as f64
    };
    points.iter().filter(is_shown).copied().collect()
}

/// A sphere around nearly all of the points; `None` if there are too few.
pub(crate) fn sphere_around(points: &[DVec3]) -> Option<Sphere<f64>> {
    if points.len() < LEAST_POINTS {
        return None;
    }
    let middle = |axis: usize| {
        let mut all: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    let center = DVec3::new(middle(0), middle(1), middle(2));
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.distance(center).total_cmp(&b.distance(center)));
    sorted.truncate((CONTAINED * sorted.len() as f64).ceil() as usize);
    enclosing_sphere(&sorted, 0.0)
}

/// A sphere around the points, if nearly all of them lie where the object is: around a centre
/// inside `framed`, the sphere that the median camera sees whole, and not much farther than that
/// sphere reaches. `None` for the points of a room.
pub(crate) fn sphere_of_compact(points: &[DVec3], framed: &Sphere<f64>) -> Option<Sphere<f64>> {
    let is_compact = |cloud: &Sphere<f64>| {
        cloud.center.distance(framed.center) < framed.radius
            && cloud.radius <= MOST_OF_FRAMED * framed.radius
    };
    sphere_around(points).filter(is_compact)
}

/// A sphere around nearly all of the points inside `framed`, the sphere that the median camera sees
/// whole, with its centre and at most its radius; `room` is a factor on the radius. `None` if there
/// are too few.
///
/// Most points can be on the table or in the room around the object, so they tell how small the
/// sphere may be, and not its centre. They can also be on one textured part of the object, so the
/// sphere keeps most of the radius.
pub(crate) fn sphere_of_inner(
    points: &[DVec3],
    framed: &Sphere<f64>,
    room: f64,
) -> Option<Sphere<f64>> {
    let distances = points.iter().map(|p| p.distance(framed.center));
    let mut inside: Vec<f64> = distances.filter(|d| *d < framed.radius).collect();
    if inside.len() < LEAST_POINTS {
        return None;
    }
    inside.sort_by(f64::total_cmp);
    let reach = inside[(CONTAINED * (inside.len() - 1) as f64) as usize];
    let radius = (room * reach).clamp(LEAST_OF_FRAMED * framed.radius, framed.radius);
    Some(Sphere { radius, ..*framed })
}

/// The points that stand out of the plane on which most of them lie, on the side of `eye`; `radius`
/// is that of the sphere that the median camera sees whole. `None` without such a plane, or if
/// hardly any point stands out of it.
///
/// Fischler and Bolles, "Random Sample Consensus", Communications of the ACM 24(6), 1981.
pub(crate) fn before_plane(points: &[DVec3], eye: DVec3, radius: f64) -> Option<Vec<DVec3>> {
    if points.len() < LEAST_POINTS {
        return None;
    }
    let step = points.len().div_ceil(COMPARED);
    let compared: Vec<DVec3> = points.iter().step_by(step).copied().collect();
    let stream = Stream::of_seed(0).named(PLANE);
    // A point of the plane, and its unit normal towards the eye.
    let plane = |k: u64| {
        let point = |i: u64| {
            let place = stream.at(k).at(i).unit() * compared.len() as f64;
            compared[(place as usize).min(compared.len() - 1)]
        };
        let [a, b, c] = [0, 1, 2].map(point);
        let normal = (b - a).cross(c - a).try_normalize()?;
        Some((a, normal * (eye - a).dot(normal).signum()))
    };
    let height = |(a, normal): (DVec3, DVec3), x: DVec3| (x - a).dot(normal) / radius;
    let on = |plane| compared.iter().filter(|x| height(plane, **x).abs() < ON_PLANE).count();
    let counted = (0..PLANES).filter_map(plane).map(|plane| (on(plane), plane));
    let (count, best) = counted.max_by_key(|(count, _)| *count)?;
    let before: Vec<DVec3> =
        points.iter().filter(|x| height(best, **x) > BEFORE_PLANE).copied().collect();
    let is_plane = count as f64 >= LEAST_ON_PLANE * compared.len() as f64;
    let is_enough = before.len() as f64 >= LEAST_BEFORE * points.len() as f64;
    (is_plane && is_enough).then_some(before)
}
