//! The sphere's outline and the world's axes on every view.

use field::Sphere;
use glam::{DVec2, DVec3};

use crate::{Dataset, View};
use film::Film;
use film::contact_sheet;

/// The widest a view is shown, in pixels.
const WIDEST: u32 = 256;

/// Views side by side.
const COLUMNS: usize = 7;

const OUTLINE: [f32; 3] = [1.0, 0.6, 0.0];
const AXES: [[f32; 3]; 3] = [[1.0, 0.05, 0.05], [0.05, 0.8, 0.05], [0.1, 0.2, 1.0]];

/// One picture of all views, training views first, each with the sphere's outline (orange) and the
/// axes from its centre, as long as its radius: x red, y green, z blue.
pub fn overlay(dataset: &Dataset, bounds: &Sphere<f64>) -> Film {
    let views: Vec<&View> = dataset.train.iter().chain(&dataset.test).collect();
    let shown: Vec<Film> = views.iter().map(|view| draw(view, bounds)).collect();
    let rows: Vec<Vec<Film>> = shown.chunks(COLUMNS).map(<[Film]>::to_vec).collect();
    contact_sheet(&rows)
}

fn draw(view: &View, bounds: &Sphere<f64>) -> Film {
    let factor = view.image.width.div_ceil(WIDEST).max(1);
    let mut film = view.image.downscaled(factor);
    let camera = &view.camera;
    let mut mark = |x: DVec3, color: [f32; 3]| {
        if let Some(u) = camera.project(x) {
            dot(&mut film, u / f64::from(factor), color);
        }
    };
    // The outline is the circle where rays from the eye touch the sphere.
    let axis = camera.eye - bounds.center;
    let distance = axis.length();
    if distance > bounds.radius {
        let along = axis / distance;
        let (a, b) = along.any_orthonormal_pair();
        let center = bounds.center + along * (bounds.radius * bounds.radius / distance);
        let radius = bounds.radius * (1.0 - (bounds.radius / distance).powi(2)).sqrt();
        for i in 0..2000 {
            let (s, c) = (f64::from(i) / 2000.0 * std::f64::consts::TAU).sin_cos();
            mark(center + radius * (c * a + s * b), OUTLINE);
        }
    }
    for (axis, color) in DVec3::AXES.into_iter().zip(AXES) {
        (0..400).for_each(|i| {
            mark(bounds.center + axis * (bounds.radius * f64::from(i) / 400.0), color)
        });
    }
    film
}

fn dot(film: &mut Film, u: DVec2, color: [f32; 3]) {
    let inside =
        u.x >= 0.0 && u.y >= 0.0 && u.x < f64::from(film.width) && u.y < f64::from(film.height);
    if inside {
        film.pixels[u.y as usize * film.width as usize + u.x as usize] = color;
    }
}
