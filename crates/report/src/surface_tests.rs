//! Shares of surfaces with closed forms, and the PSNR of a known error.

use field::UniformBackground;
use field::{Csg, Operation, Shape};
use film::Film;
use glam::{DVec2, DVec3, Vec3};
use render::{Analytic, Camera, Formula};

use super::*;
use crate::sampled_psnr;

const UNIT: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 1.0 };

/// A camera at `eye` that sees the unit sphere whole.
fn camera(eye: DVec3) -> Camera {
    let (focal, middle) = (DVec2::splat(60.0), DVec2::splat(24.0));
    let up = DVec3::new(0.1, 0.2, 1.0);
    Camera::look_at(48, 48, focal, middle, eye, DVec3::ZERO, up).unwrap()
}

/// The union of balls with these centres on the x axis and these radii.
fn balls(balls: &[(f64, f64)]) -> Csg<f32> {
    let ball = |(x, radius): &(f64, f64)| -> Box<dyn field::Field<f32>> {
        Box::new(Shape::sphere([*x, 0.0, 0.0], *radius))
    };
    Csg::new(Operation::Union, balls.iter().map(ball).collect())
}

fn shares(field: &Csg<f32>, eyes: &[DVec3]) -> Option<SurfaceShares> {
    let shader = Analytic { formula: Formula::Constant, parameters: vec![1.0; 3] };
    let background = UniformBackground(Vec3::ZERO);
    let cameras: Vec<Camera> = eyes.iter().map(|eye| camera(*eye)).collect();
    let scene = Scene::new(field, &shader, &cameras, &UNIT, &background);
    surface_shares(&scene, &UNIT, 0..cameras.len()).unwrap()
}

#[test]
fn one_camera_sees_the_cap_of_a_ball_that_faces_it() {
    // A camera at distance d sees the part (1 − r/d)/2 of a ball of radius r.
    let found = shares(&balls(&[(0.0, 0.5)]), &[DVec3::X * 4.0]).unwrap();
    assert!((found.unseen - (1.0 - 0.4375)).abs() < 0.02, "{found:?}");
    assert!((found.unseen_sides - (1.0 - 0.4375)).abs() < 0.05, "{found:?}");
    assert_eq!((found.on_sphere, found.seen_on_sphere), (0.0, 0.0));
    let around = DVec3::AXES.map(|axis| [axis * 4.0, axis * -4.0]).concat();
    let found = shares(&balls(&[(0.0, 0.5)]), &around).unwrap();
    assert!(found.unseen < 0.01, "{found:?}");
    let nothing = shares(&balls(&[(0.0, 0.5)]), &[]).unwrap();
    assert_eq!(nothing.unseen, 1.0);
}

#[test]
fn a_ball_behind_another_is_unseen() {
    let two = balls(&[(0.4, 0.3), (-0.4, 0.2)]);
    let found = shares(&two, &[DVec3::X * 4.0]).unwrap();
    // The share (1 − 0.3/3.6)/2 of the front ball, of 0.3² of the area in 0.3² + 0.2².
    let seen = 0.5 * (1.0 - 0.3 / 3.6) * 0.09 / 0.13;
    assert!((found.unseen - (1.0 - seen)).abs() < 0.02, "{found:?} and {seen}");
}

#[test]
fn a_solid_that_leaves_the_sphere_lies_on_it() {
    // The unit ball without its part above x = 0: a hemisphere on the sphere, and a disc.
    let plane: Box<dyn field::Field<f32>> =
        Box::new(Shape::new(field::Kind::Plane, &[1.0, 0.0, 0.0, 0.0]));
    let half = Csg::new(Operation::Union, vec![plane]);
    let found = shares(&half, &[DVec3::X * 4.0]).unwrap();
    assert!((found.on_sphere - 2.0 / 3.0).abs() < 0.03, "{found:?}");
    // The camera above sees the disc, but for its rim, alone.
    assert!(found.seen_on_sphere < 0.03, "{found:?}");
    assert!((found.unseen - 2.0 / 3.0).abs() < 0.03, "{found:?}");
    // The rays of the camera below start in the solid: the cap is in view.
    let found = shares(&half, &[DVec3::X * -4.0]).unwrap();
    assert!((found.seen_on_sphere - 0.5 * 0.75 * 4.0 / 3.0).abs() < 0.05, "{found:?}");
}

#[test]
fn a_table_on_the_sphere_is_no_cut() {
    // The part of the unit ball below z = −0.2, and a ball on it; cameras look down from around.
    let table = Shape::new(field::Kind::Plane, &[0.0, 0.0, 1.0, -0.2]);
    let ball = Shape::sphere([0.0, 0.0, 0.05], 0.3);
    let eyes: Vec<DVec3> = (0..8)
        .map(|i| {
            let (s, c) = (f64::from(i) * 0.785).sin_cos();
            DVec3::new(3.0 * c, 3.0 * s, 1.0)
        })
        .collect();
    let on_table = Csg::new(Operation::Union, vec![Box::new(table), Box::new(ball)]);
    let found = shares(&on_table, &eyes).unwrap();
    assert!(found.seen_on_sphere > 0.1 && found.seen_above_table < 0.01, "{found:?}");
    // The underside of the table is no fault of the capture. One camera does not see all sides.
    assert!(found.unseen > 0.1 && found.unseen_sides < 0.05, "{found:?}");
    let found = shares(&on_table, &eyes[..1]).unwrap();
    assert!(found.unseen_sides > 0.3, "{found:?}");
    // A wall to its side is no table.
    let wall = Shape::new(field::Kind::Plane, &[-1.0, 0.0, 0.0, -0.2]);
    let ball = Shape::sphere([0.0, 0.0, 0.05], 0.3);
    let at_wall = Csg::new(Operation::Union, vec![Box::new(wall), Box::new(ball)]);
    let found = shares(&at_wall, &eyes).unwrap();
    assert!(found.seen_above_table > 0.1, "{found:?}");
    assert_eq!(found.seen_above_table, found.seen_on_sphere);
}

#[test]
fn no_surface_has_no_shares() {
    assert_eq!(shares(&balls(&[(0.0, -0.5)]), &[DVec3::X * 4.0]), None);
}

#[test]
fn the_psnr_of_a_known_error() {
    let ball = balls(&[(0.0, 0.5)]);
    let shader = Analytic { formula: Formula::Constant, parameters: vec![1.0; 3] };
    let background = UniformBackground(Vec3::ZERO);
    let cameras = [camera(DVec3::X * 4.0), camera(DVec3::Y * 4.0)];
    let scene = Scene::new(&ball, &shader, &cameras, &UNIT, &background);
    let view = |camera: Camera, shown: f32| dataset::View {
        name: String::new(),
        path: Default::default(),
        camera,
        image: Film { width: 48, height: 48, pixels: vec![[shown; 3]; 48 * 48] },
        mask: None,
    };
    // White everywhere: the error is 1 where rays meet the sphere and miss the ball. The film areas
    // of a ball of radius r at distance 4 are in proportion to r²/(16 − r²).
    let area = |r: f64| r * r / (16.0 - r * r);
    let expected = -10.0 * (1.0 - area(0.5) / area(1.0)).log10();
    for (number, numbers) in [(0, 0..1), (1, 1..2)] {
        let views = [view(cameras[number], 1.0)];
        let found = sampled_psnr(&scene, &UNIT, &views, numbers, false).unwrap().unwrap();
        assert!((found - expected).abs() < 0.2, "{found} and {expected}");
    }
    assert_eq!(sampled_psnr(&scene, &UNIT, &[], 0..0, true).unwrap(), None);
}
