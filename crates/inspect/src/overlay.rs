//! A picture of all views with the sphere's outline and the world's axes.

use field::Sphere;
use glam::{DVec2, DVec3};

use dataset::{Dataset, View};
use film::{Film, contact_sheet, labelled};

/// The largest width of a view in the picture, in pixels.
const WIDEST: u32 = 256;

/// Views in a row.
const COLUMNS: usize = 7;

/// The most points on surfaces that are drawn.
const MOST_POINTS: usize = 1000;

/// Linear RGB of points on surfaces inside the sphere (cyan) and outside it (grey).
const INNER: [f32; 3] = [0.0, 0.9, 0.9];
const OUTER: [f32; 3] = [0.5; 3];

/// Points drawn along the sphere's outline, and along each axis.
const OUTLINE_POINTS: u32 = 2000;
const AXIS_POINTS: u32 = 400;

/// Linear RGB of the outline (orange) and of the x, y and z axes (red, green, blue).
const OUTLINE: [f32; 3] = [1.0, 0.6, 0.0];
const AXES: [[f32; 3]; 3] = [[1.0, 0.05, 0.05], [0.05, 0.8, 0.05], [0.1, 0.2, 1.0]];

/// One picture of all views, training views first, in rows of seven.
///
/// Each view shows the sphere's outline in orange, and the world's axes from the sphere's centre to
/// its surface: x red, y green, z blue, and its name above it. It shows up to 1,000 of the `points`
/// on surfaces, hidden ones too: those in the sphere in cyan, the others in grey. Views wider than
/// 256 pixels are reduced.
pub fn overlay(dataset: &Dataset, bounds: &Sphere<f64>, points: &[DVec3]) -> Film {
    let views: Vec<&View> = dataset.train.iter().chain(&dataset.test).collect();
    let step = points.len().div_ceil(MOST_POINTS).max(1);
    let points: Vec<DVec3> = points.iter().step_by(step).copied().collect();
    let drawn: Vec<Film> = views.iter().map(|view| draw(view, bounds, &points)).collect();
    let rows: Vec<Vec<Film>> = drawn.chunks(COLUMNS).map(<[Film]>::to_vec).collect();
    contact_sheet(&rows)
}

fn draw(view: &View, bounds: &Sphere<f64>, points: &[DVec3]) -> Film {
    let factor = view.image.width.div_ceil(WIDEST).max(1);
    let mut film = view.image.downscaled(factor);
    let mut mark = |x: DVec3, color: [f32; 3]| {
        if let Some(u) = view.camera.project(x) {
            dot(&mut film, u / f64::from(factor), color);
        }
    };
    for x in points {
        let is_inside = x.distance(bounds.center) < bounds.radius;
        mark(*x, if is_inside { INNER } else { OUTER });
    }
    for x in outline(view.camera.eye, bounds) {
        mark(x, OUTLINE);
    }
    for (axis, color) in DVec3::AXES.into_iter().zip(AXES) {
        for i in 0..AXIS_POINTS {
            let length = bounds.radius * f64::from(i) / f64::from(AXIS_POINTS);
            mark(bounds.center + axis * length, color);
        }
    }
    labelled(&film, &view.name)
}

/// Points on the circle where rays from the eye touch the sphere. Empty for an eye in the sphere.
fn outline(eye: DVec3, bounds: &Sphere<f64>) -> Vec<DVec3> {
    let to_eye = eye - bounds.center;
    let distance = to_eye.length();
    if distance <= bounds.radius {
        return Vec::new();
    }
    let along = to_eye / distance;
    let (a, b) = along.any_orthonormal_pair();
    let center = bounds.center + along * (bounds.radius * bounds.radius / distance);
    let radius = bounds.radius * (1.0 - (bounds.radius / distance).powi(2)).sqrt();
    (0..OUTLINE_POINTS)
        .map(|i| {
            let angle = f64::from(i) / f64::from(OUTLINE_POINTS) * std::f64::consts::TAU;
            let (s, c) = angle.sin_cos();
            center + radius * (c * a + s * b)
        })
        .collect()
}

/// Colours the pixel at film position `u`, if it is on the film.
fn dot(film: &mut Film, u: DVec2, color: [f32; 3]) {
    let inside =
        u.x >= 0.0 && u.y >= 0.0 && u.x < f64::from(film.width) && u.y < f64::from(film.height);
    if inside {
        film.pixels[u.y as usize * film.width as usize + u.x as usize] = color;
    }
}
