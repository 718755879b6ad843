//! The sphere that cameras frame.

use dataset::{Dataset, View};
use field::Sphere;
use glam::{DMat3, DVec2, DVec3};

/// The largest radius of a sphere estimated from cameras, as a fraction of the distance of the
/// nearest camera: cameras must be outside.
const MOST_OF_DISTANCE: f64 = 0.9;

/// Axes count as parallel if the determinant of their normal equations, divided by the cube of the
/// number of views, is below this.
const PARALLEL: f64 = 1e-9;

/// The weight of a depth beside that of an optical axis: cameras miss what they look at by about a
/// quarter of its radius, and depths, which are those of its front, by half of it. The depths of
/// cameras all around an object hardly count, since they pull to all sides. If all cameras look at
/// one side, they decide the distance.
const WEIGHT_OF_DEPTHS: f64 = 0.2;

/// Steps of the iteration that finds the depths that are far off.
const STEPS: usize = 20;

/// The sphere around `center` that the median camera sees whole.
pub(crate) fn framed(views: &[View], center: DVec3) -> Sphere<f64> {
    sphere_in_view(views, center, DVec2::min_element)
}

/// The sphere around the point at which the cameras aim, which fills the median view to its
/// corners.
pub(crate) fn widest(views: &[View]) -> Sphere<f64> {
    sphere_in_view(views, aimed_point(views), |half| half.length())
}

/// Whether all cameras are well outside a sphere, also those of held-out views.
pub(crate) fn is_clear_of_cameras(dataset: &Dataset, sphere: &Sphere<f64>) -> bool {
    sphere.radius <= radius_clear_of_cameras(dataset, sphere.center)
}

/// The largest radius of a sphere around `center` that leaves all cameras well outside, also those
/// of held-out views.
pub fn radius_clear_of_cameras(dataset: &Dataset, center: DVec3) -> f64 {
    let all = [&dataset.train, &dataset.test];
    MOST_OF_DISTANCE
        * all.map(|views| nearest(views, center)).into_iter().fold(f64::INFINITY, f64::min)
}

/// The distance of the nearest camera from a point.
fn nearest(views: &[View], point: DVec3) -> f64 {
    views.iter().map(|v| v.camera.eye.distance(point)).fold(f64::INFINITY, f64::min)
}

/// A sphere that the median camera sees.
///
/// `extent` maps half the film's size, in tangents, to the tangent of the cone that the sphere
/// fills: the least element for a sphere within the film, the length for one up to its corners.
fn sphere_in_view(views: &[View], center: DVec3, extent: impl Fn(DVec2) -> f64) -> Sphere<f64> {
    let radius = |v: &View| {
        let half = film_size(v) / 2.0 / v.camera.focal;
        v.camera.eye.distance(center) * extent(half).atan().sin()
    };
    let mut radii: Vec<f64> = views.iter().map(radius).collect();
    radii.sort_by(f64::total_cmp);
    let most = MOST_OF_DISTANCE * nearest(views, center);
    Sphere { center, radius: radii[radii.len() / 2].min(most) }
}

/// The film's width and height in pixels.
fn film_size(view: &View) -> DVec2 {
    DVec2::new(f64::from(view.camera.width), f64::from(view.camera.height))
}

/// The direction of the ray through the film's centre.
pub(crate) fn central_ray(view: &View) -> DVec3 {
    view.camera.direction(film_size(view) / 2.0)
}

/// Normal equations of a point: Σ P x = Σ P eye, with projections P.
struct Normal {
    matrix: DMat3,
    right: DVec3,
}

impl Normal {
    fn add(&mut self, projection: DMat3, through: DVec3) {
        self.matrix += projection;
        self.right += projection * through;
    }
}

/// The projection onto a unit vector.
fn onto(d: DVec3) -> DMat3 {
    DMat3::from_cols(d * d.x, d * d.y, d * d.z)
}

/// The equations of the rays through the films' centres.
fn axes(views: &[View]) -> Normal {
    let mut axes = Normal { matrix: DMat3::ZERO, right: DVec3::ZERO };
    for view in views {
        axes.add(DMat3::IDENTITY - onto(central_ray(view)), view.camera.eye);
    }
    axes
}

/// The point at which the cameras aim: the nearest one, in the least-squares sense, to the rays
/// through the films' centres. For one ray, or parallel rays, it is the point at unit distance in
/// front of the cameras' mean position.
pub(crate) fn aimed_point(views: &[View]) -> DVec3 {
    let Normal { matrix, right } = axes(views);
    let mean = views.iter().map(|v| v.camera.eye).sum::<DVec3>() / views.len() as f64;
    let parallel = matrix.determinant().abs() < PARALLEL * (views.len() as f64).powi(3);
    if parallel { mean + central_ray(&views[0]) } else { matrix.inverse() * right }
}

/// Depths of what some of the views show in the middle of their films.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Depths {
    /// The numbers of views, each with a distance along the ray through the film's centre.
    pub(crate) of_views: Vec<(usize, f64)>,
    /// The number of views whose depths were searched: each stands for as many as there are views
    /// for one that was searched.
    pub(crate) searched: usize,
}

/// The point at which the cameras aim, by their axes and by depths along them: those that are far
/// off the others hardly count.
///
/// # Panics
/// If there are no depths.
pub(crate) fn aimed_point_at(views: &[View], depths: &Depths) -> DVec3 {
    let targets: Vec<(DVec3, DVec3)> = depths
        .of_views
        .iter()
        .map(|(i, depth)| (central_ray(&views[*i]), views[*i].camera.eye, *depth))
        .map(|(d, eye, depth)| (d, eye + d * depth))
        .collect();
    let each = WEIGHT_OF_DEPTHS * views.len() as f64 / depths.searched as f64;
    let mut weights = vec![each; targets.len()];
    let mut center = DVec3::ZERO;
    for _ in 0..STEPS {
        let mut all = axes(views);
        for ((d, target), weight) in targets.iter().zip(&weights) {
            all.add(onto(*d) * *weight, *target);
        }
        center = all.matrix.inverse() * all.right;
        let off: Vec<f64> = targets.iter().map(|(d, x)| (center - x).dot(*d).abs()).collect();
        let mut sorted = off.clone();
        sorted.sort_by(f64::total_cmp);
        let scale = sorted[sorted.len() / 2].max(f64::MIN_POSITIVE);
        weights = off.iter().map(|off| each / (1.0 + (off / scale).powi(2))).collect();
    }
    center
}
