use super::*;
use estimate::gradient::{Direction, Sampling, differentiate};
use estimate::{Discontinuity, SampleCounts};
use field::UniformBackground;
use field::{Kind, Shape, Sphere};
use glam::{DVec2, DVec3};
use render::{Analytic, Camera, Formula};

/// The derivative of the area of a ball on the film by its radius, in square pixels per world unit.
fn disc(radius: f64, distance: f64, focal: f64) -> f64 {
    let square = distance * distance - radius * radius;
    let outline = focal * radius / square.sqrt();
    std::f64::consts::TAU * outline * focal * distance * distance / square.powf(1.5)
}

#[test]
fn the_derivative_by_the_radius_of_a_ball_is_that_of_its_area_on_the_film() {
    let ball = Shape::<f64>::sphere([0.0; 3], 0.7);
    let white = Analytic { formula: Formula::Constant, parameters: vec![1.0; 3] };
    let (focal, centre) = (DVec2::splat(24.0), DVec2::splat(6.0));
    let eye = DVec3::new(0.0, 0.0, 4.0);
    let camera = Camera::look_at(12, 12, focal, centre, eye, DVec3::ZERO, DVec3::Y).unwrap();
    let (cameras, bounds) = ([camera], Sphere { center: DVec3::ZERO, radius: 1.4 });
    let scene = Scene::new(&ball, &white, &cameras, &bounds, &UniformBackground(DVec3::ZERO));
    // Over 16 seeds the standard deviation is 0.65 % with 256 lines, and 0.19 % with 1024.
    let sampling = Sampling { counts: SampleCounts { spp: 16, edge_samples: 1024 }, seed: 1 };
    let image = differentiate(&scene, &[Direction::Field(3)], &Crofton, sampling, &|_| {});
    let sum: f64 = image.unwrap()[0].film.pixels.iter().map(|p| f64::from(p[0])).sum();
    let expected = disc(0.7, 4.0, 24.0);
    assert!((sum / expected - 1.0).abs() < 0.01, "{sum} against {expected}");
}

#[test]
fn creases_of_a_shaded_box_are_left_out() {
    let cube = Shape::<f64>::new(Kind::Box, &[0.0, 0.0, 0.0, 0.5, 0.5, 0.5]);
    let bounds = Sphere { center: DVec3::ZERO, radius: 1.4 };
    for (formula, expected) in
        [(Formula::Normal, vec![Discontinuity::Creases]), (Formula::Constant, Vec::new())]
    {
        let shader = Analytic { formula, parameters: vec![1.0; 3] };
        let scene = Scene::new(&cube, &shader, &[], &bounds, &UniformBackground(DVec3::ZERO));
        assert_eq!(Crofton.unmodelled(&scene), expected);
    }
}
