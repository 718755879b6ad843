//! Corrections against differences, and the gauge against motions of the world.

use approx::assert_relative_eq;
use field::Sphere;
use glam::{DMat4, DQuat, DVec2, DVec3};
use random::{Name, Stream};
use render::{Camera, CameraAdjoint};

use crate::calibrate::gauge::Gauge;
use crate::calibrate::{Calibration, CalibrationError, Freedom};

const SPHERE: Sphere<f64> = Sphere { center: DVec3::new(0.3, -0.2, 0.5), radius: 1.2 };

const ALL: Freedom = Freedom { poses: true, focal: true, lens: true };

/// Random eyes around the sphere, with two lenses.
fn cameras() -> Vec<Camera> {
    let stream = Stream::of_seed(3).named(Name::other("cameras"));
    let camera = |i: u64| {
        let eye = SPHERE.center + DVec3::from(stream.at(i).in_ball()).normalize() * 5.0;
        let focal = DVec2::new(150.0, if i.is_multiple_of(2) { 150.0 } else { 170.0 });
        let (middle, target) = (DVec2::new(62.0, 51.0), SPHERE.center + DVec3::splat(0.1));
        Camera::look_at(120, 100, focal, middle, eye, target, DVec3::Z).unwrap()
    };
    (0..6).map(camera).collect()
}

/// A number that depends on all parameters of all cameras at half of their size: the sum of the
/// directions of some rays and of the eyes, weighted.
fn seen(cameras: &[Camera]) -> (f64, Vec<CameraAdjoint>) {
    let stream = Stream::of_seed(4).named(Name::other("cameras"));
    let mut sum = 0.0;
    let adjoints = cameras.iter().enumerate().map(|(i, camera)| {
        let mut adjoint = CameraAdjoint::default();
        for k in 0..4 {
            let own = stream.at(i as u64).at(k);
            let u = DVec2::new(60.0 * own.at(0).unit(), 50.0 * own.at(1).unit());
            let [eye, direction] = [2, 3].map(|j| DVec3::from(own.at(j).in_ball()));
            sum += eye.dot(camera.eye) + direction.dot(camera.direction(u));
            adjoint += camera.ray_vjp(u, eye, direction);
        }
        adjoint
    });
    let adjoints = adjoints.collect();
    (sum, adjoints)
}

/// The same camera with a film of half of the size.
fn halved(camera: &Camera) -> Camera {
    camera.resized(camera.width / 2, camera.height / 2)
}

/// A calibration with random corrections of some pixels.
fn moved(freedom: Freedom) -> Calibration {
    let mut calibration = Calibration::new(cameras(), SPHERE, freedom);
    let n = calibration.state().0.len();
    let stream = Stream::of_seed(6).named(Name::other("cameras"));
    let parameters: Vec<f64> = (0..n).map(|i| 4.0 * stream.at(i as u64).unit() - 2.0).collect();
    calibration.restore(&parameters, &vec![0.0; n], &vec![0.0; n], 0).unwrap();
    calibration
}

#[test]
fn the_gradient_by_corrections_matches_differences() {
    let (calibration, bases) = (moved(ALL), cameras().iter().map(halved).collect::<Vec<_>>());
    let corrected = |c: &Calibration| -> Vec<Camera> {
        bases.iter().enumerate().map(|(view, base)| c.apply(view, base)).collect()
    };
    let (_, adjoints) = seen(&corrected(&calibration));
    let gradient = calibration.gradient(&bases, &adjoints);
    let (start, n) = (calibration.state().0.to_vec(), gradient.len());
    for (i, found) in gradient.into_iter().enumerate() {
        let at = |h: f64| {
            let (mut parameters, zero) = (start.clone(), vec![0.0; n]);
            parameters[i] += h;
            let mut moved = calibration.clone();
            moved.restore(&parameters, &zero, &zero, 0).unwrap();
            seen(&corrected(&moved)).0
        };
        let difference = (at(1e-4) - at(-1e-4)) / 2e-4;
        // The prior's part is 1e-5 of a correction.
        assert_relative_eq!(found, difference, epsilon = 2e-5);
    }
}

#[test]
fn parameters_that_are_not_free_stay() {
    for (freedom, free) in [
        (Freedom::POSES, 36),
        (Freedom { focal: true, ..Freedom::POSES }, 38),
        (ALL, 46),
        (Freedom { poses: false, focal: true, lens: false }, 2),
    ] {
        let mut calibration = Calibration::new(cameras(), SPHERE, freedom);
        let (_, adjoints) = seen(&cameras());
        calibration.step(&cameras(), &adjoints, 0.5).unwrap();
        let changed = calibration.state().0.iter().filter(|p| **p != 0.0).count();
        assert_eq!(changed, free, "{freedom:?}");
    }
}

#[test]
fn the_gauge_is_that_of_motions_and_scalings_of_the_world() {
    let cameras = cameras();
    let gauge = Gauge::new(&cameras, &SPHERE);
    // The world turns about the sphere, moves and grows, by little.
    let h = 1e-5;
    let turn = DQuat::from_scaled_axis(DVec3::new(0.4, -0.7, 0.2) * h);
    let world = |x: DVec3| {
        let shift = DVec3::new(-0.3, 0.5, 0.9) * h;
        SPHERE.center + (turn * (x - SPHERE.center)) * (1.0 + 0.6 * h) + shift
    };
    let point = SPHERE.center + DVec3::new(0.5, 0.4, -0.3);
    let mut poses = Vec::new();
    for camera in &cameras {
        let rotated = DMat4::from_quat(turn) * camera.pose();
        let pose = DMat4 { w_axis: world(camera.eye).extend(1.0), ..rotated };
        let Camera { width, height, focal, principal, .. } = *camera;
        let moved = Camera::from_pose(width, height, focal, principal, pose).unwrap();
        let (before, after) =
            (camera.project(point).unwrap(), moved.project(world(point)).unwrap());
        assert_relative_eq!(before, after, epsilon = 1e-9);
        let units = crate::calibrate::units::of_pose(camera, &SPHERE);
        let (turn, shift) = (turn.to_scaled_axis(), moved.eye - camera.eye);
        let all = [turn.to_array(), shift.to_array()].concat();
        poses.extend(all.iter().zip(units).map(|(v, unit)| v / unit / h));
    }
    let length = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    let before = length(&poses);
    gauge.hold(&mut poses);
    assert!(length(&poses) < 1e-4 * before, "{} of {before} is left", length(&poses));
    // Another correction has a part outside the gauge.
    let mut single = vec![0.0; poses.len()];
    single[0] = 1.0;
    gauge.hold(&mut single);
    assert!(length(&single) > 0.5);
}

#[test]
fn held_out_views_have_the_lens_of_their_group() {
    let calibration = moved(ALL);
    let (given, corrected) = (cameras(), calibration.cameras());
    for (given, corrected) in given.iter().zip(&corrected) {
        let other = Camera { eye: given.eye + DVec3::ONE, ..*given };
        let found = calibration.apply_lens(&other);
        assert_eq!((found.focal, found.principal), (corrected.focal, corrected.principal));
        assert_eq!((found.radial, found.eye), (corrected.radial, other.eye));
    }
    let other = Camera { width: 121, ..given[0] };
    assert_eq!(calibration.apply_lens(&other), other, "a lens that no view has");
}

#[test]
fn a_state_is_restored_and_a_wrong_one_is_refused() {
    let mut calibration = moved(ALL);
    calibration.step(&cameras(), &seen(&cameras()).1, 0.1).unwrap();
    let (parameters, first, second, steps) = calibration.state();
    let mut restored = Calibration::new(cameras(), SPHERE, ALL);
    restored.restore(parameters, first, second, steps).unwrap();
    assert_eq!(restored, calibration);
    let short = restored.restore(&parameters[1..], &first[1..], &second[1..], steps);
    assert_eq!(short, Err(CalibrationError::Count { found: 45, expected: 46 }));
    let nan = vec![CameraAdjoint { eye: DVec3::NAN, ..CameraAdjoint::default() }; 6];
    let before = restored.clone();
    assert!(restored.step(&cameras(), &nan, 0.1).is_err());
    assert_eq!(restored, before);
}
