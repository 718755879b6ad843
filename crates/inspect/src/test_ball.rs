//! Photographs of a ball, in memory: the data set of the tests.

use dataset::{Dataset, View};
use field::Sphere;
use film::Film;
use glam::{DVec2, DVec3};
use render::Camera;

const WIDTH: u32 = 48;
const HEIGHT: u32 = 40;
pub(crate) const BACKGROUND: [f32; 3] = [0.05, 0.1, 0.2];

/// The object of the photographs.
pub(crate) fn ball() -> Sphere<f64> {
    Sphere { center: DVec3::new(0.2, -0.1, 0.3), radius: 0.5 }
}

/// Cameras all around the ball, aimed at points up to 0.07 from its centre.
pub(crate) fn cameras(count: usize) -> Vec<Camera> {
    let (focal, principal) = (DVec2::new(90.0, 88.0), DVec2::new(23.0, 21.5));
    (0..count)
        .map(|i| {
            let (azimuth, height) = (2.4 * i as f64, (1.7 * i as f64).sin());
            let eye =
                ball().center + 3.0 * DVec3::new(azimuth.cos(), azimuth.sin(), height).normalize();
            let target =
                ball().center + 0.05 * DVec3::new((3.0 * azimuth).sin(), azimuth.cos(), 0.0);
            Camera::look_at(WIDTH, HEIGHT, focal, principal, eye, target, DVec3::Z).unwrap()
        })
        .collect()
}

/// An image of the ball, brighter than the background, coloured by its normal.
pub(crate) fn photograph(camera: &Camera) -> Film {
    let mut film = Film::new(camera.width, camera.height);
    for (i, pixel) in film.pixels.iter_mut().enumerate() {
        let u = DVec2::new(
            f64::from(i as u32 % camera.width) + 0.5,
            f64::from(i as u32 / camera.width) + 0.5,
        );
        let direction = camera.direction(u);
        *pixel = match ball().clip(camera.eye, direction) {
            Some((t, _)) => {
                let n = (camera.eye + direction * t - ball().center) / ball().radius;
                (n * 0.3 + 0.6).as_vec3().to_array()
            }
            None => BACKGROUND,
        };
    }
    film
}

/// The photographs of these cameras, of which every eighth is held out.
pub(crate) fn photographed(cameras: &[Camera]) -> Dataset {
    let view = |camera: &Camera| View {
        name: String::new(),
        path: Default::default(),
        camera: *camera,
        image: photograph(camera),
        mask: None,
    };
    let every = |held_out: bool| {
        cameras.iter().enumerate().filter(move |(i, _)| (i % 8 == 0) == held_out).map(|c| c.1)
    };
    Dataset {
        path: "ball".into(),
        format: "test".to_owned(),
        train: every(false).map(view).collect(),
        test: every(true).map(view).collect(),
        bounds: None,
        points: Vec::new(),
        is_sure: Vec::new(),
        notes: Vec::new(),
    }
}
