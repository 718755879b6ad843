//! The bounding sphere of the object: from the data set, or estimated.

use field::Sphere;
use glam::{DMat3, DVec2, DVec3};

use crate::carve::visual_hull_sphere;
use crate::{Background, Dataset, View};
use io::InputError;

/// Room around an estimated sphere, as a factor on the radius. Carved cells are coarse, and warp
/// fields need both sides of a silhouette.
const MARGIN: f64 = 1.1;

/// The least confidence of a background with which the volume is carved.
const LEAST_CONFIDENCE: f32 = 0.3;

/// The least number of surface points from which a sphere is estimated.
const LEAST_POINTS: usize = 50;

/// The share of the surface points that the sphere contains. The others can be mismatches, or a
/// distant corner of a table.
const CONTAINED: f64 = 0.98;

/// The largest radius of a sphere estimated from cameras, as a fraction of the distance of the
/// nearest camera: cameras must be outside.
const MOST_OF_DISTANCE: f64 = 0.9;

/// Axes count as parallel if the determinant of their normal equations, divided by the cube of the
/// number of views, is below this.
const PARALLEL: f64 = 1e-9;

/// The bounding sphere, in the data set's units, and the background.
///
/// The sphere is the first of these that exists:
/// 1. `asked`;
/// 2. the data set's own ([`Dataset::bounds`]);
/// 3. a sphere around the visual hull of the training photographs, if their background has a
///    confidence of at least 0.3;
/// 4. a sphere around the data set's surface points, if at least 50 lie in the median view;
/// 5. a sphere that the median camera sees whole, around the point at which the cameras aim.
///
/// The background is that of the pixels around the sphere. An estimated sphere need not contain the
/// object: look at the picture that `dsdf inspect` writes.
///
/// # Panics
/// If the data set has no training views.
pub fn surroundings(dataset: &Dataset, asked: Option<Sphere<f64>>) -> (Sphere<f64>, Background) {
    let views = &dataset.train;
    if let Some(known) = asked.or(dataset.bounds) {
        return (known, Background::estimate(views, &known));
    }
    let wide = sphere_in_view(views, |half| half.length());
    let background = Background::estimate(views, &wide);
    let carved = (background.confidence >= LEAST_CONFIDENCE)
        .then(|| visual_hull_sphere(views, &wide, &background))
        .flatten()
        .map(|hull| hull.scaled(MARGIN));
    let narrow = sphere_in_view(views, DVec2::min_element);
    let sphere = carved.or_else(|| sphere_around_points(&dataset.points, &wide)).unwrap_or(narrow);
    (sphere, Background::estimate(views, &sphere))
}

/// Checks the cameras of all views against the bounding sphere.
///
/// A camera inside the sphere is refused: the object has no silhouette from there. If most cameras
/// look away from the sphere, all are refused: the poses are in another convention.
///
/// # Errors
/// For the first camera inside, or if more than half look away.
pub fn check_cameras(dataset: &Dataset, bounds: &Sphere<f64>) -> Result<(), InputError> {
    let views: Vec<&View> = dataset.train.iter().chain(&dataset.test).collect();
    let inside = |v: &&&View| (v.camera.eye - bounds.center).length() <= bounds.radius;
    if let Some(view) = views.iter().find(inside) {
        let distance = (view.camera.eye - bounds.center).length();
        let found = format!("a camera {distance:.4} from the centre {:.4}", bounds.center);
        let expected =
            format!("all cameras outside the bounding radius {:.4} (see --bounds)", bounds.radius);
        return Err(InputError::new(&dataset.path, &view.name, found, expected));
    }
    let away = views.iter().filter(|v| looks_away(v, bounds)).count();
    if 2 * away > views.len() {
        let found = format!("{away} of {} cameras look away from the bounding sphere", views.len());
        let expected = "cameras that look at it (poses in the OpenCV convention need their y and \
            z axes negated; see --bounds)";
        return Err(InputError::new(&dataset.path, "poses", found, expected));
    }
    Ok(())
}

/// True if the sphere's centre is behind the camera of `view`.
pub fn looks_away(view: &View, bounds: &Sphere<f64>) -> bool {
    (bounds.center - view.camera.eye).dot(view.camera.forward) < 0.0
}

/// The film's width and height in pixels.
fn film_size(view: &View) -> DVec2 {
    DVec2::new(f64::from(view.camera.width), f64::from(view.camera.height))
}

/// The point nearest to the rays through the films' centres, in the least-squares sense. For one
/// ray, or parallel rays, the point at unit distance in front of the cameras' mean position.
fn aimed_point(views: &[View]) -> DVec3 {
    let central_ray = |v: &View| v.camera.direction(film_size(v) / 2.0);
    // The normal equations Σ (1 − d dᵀ) x = Σ (1 − d dᵀ) eye.
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for view in views {
        let d = central_ray(view);
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        matrix += across;
        right += across * view.camera.eye;
    }
    let mean = views.iter().map(|v| v.camera.eye).sum::<DVec3>() / views.len() as f64;
    let parallel = matrix.determinant().abs() < PARALLEL * (views.len() as f64).powi(3);
    if parallel { mean + central_ray(&views[0]) } else { matrix.inverse() * right }
}

/// A sphere around the aimed point that the median camera sees.
///
/// `extent` maps half the film's size, in tangents, to the tangent of the cone that the sphere
/// fills: the least element for a sphere within the film, the length for one up to its corners.
fn sphere_in_view(views: &[View], extent: impl Fn(DVec2) -> f64) -> Sphere<f64> {
    let center = aimed_point(views);
    let mut radii: Vec<f64> = views
        .iter()
        .map(|v| {
            let half = film_size(v) / 2.0 / v.camera.focal;
            (v.camera.eye - center).length() * extent(half).atan().sin()
        })
        .collect();
    radii.sort_by(f64::total_cmp);
    let nearest =
        views.iter().map(|v| (v.camera.eye - center).length()).fold(f64::INFINITY, f64::min);
    Sphere { center, radius: radii[radii.len() / 2].min(MOST_OF_DISTANCE * nearest) }
}

/// A sphere around nearly all of the points inside the sphere `within`, which excludes the
/// background behind the object. `None` if there are too few.
///
/// The centre is the median in each coordinate.
fn sphere_around_points(points: &[DVec3], within: &Sphere<f64>) -> Option<Sphere<f64>> {
    let inside = |p: &&DVec3| (**p - within.center).length() < within.radius;
    let points: Vec<DVec3> = points.iter().filter(inside).copied().collect();
    if points.len() < LEAST_POINTS {
        return None;
    }
    let median = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let center = DVec3::new(median(0), median(1), median(2));
    let mut distances: Vec<f64> = points.iter().map(|p| (*p - center).length()).collect();
    distances.sort_by(f64::total_cmp);
    let radius = MARGIN * distances[(CONTAINED * (distances.len() - 1) as f64) as usize];
    (radius > 0.0).then_some(Sphere { center, radius })
}
