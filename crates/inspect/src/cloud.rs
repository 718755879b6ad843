//! A sphere around the points on the scene's surfaces that came with the cameras.

use field::Sphere;
use glam::DVec3;

use crate::carve::enclosing_sphere;
use dataset::View;

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
