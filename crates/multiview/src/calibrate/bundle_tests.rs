use super::*;
use crate::calibrate::{Matching, off_views};
use field::Sphere;
use glam::DQuat;
use random::{Name, Stream};

const SPHERE: Sphere<f64> = Sphere { center: DVec3::new(0.2, 0.1, -0.3), radius: 1.0 };
const FOCAL: Freedom = Freedom { poses: true, focal: true, lens: false };

fn random(i: u64) -> Stream {
    Stream::of_seed(5).named(Name::other("points and cameras")).at(i)
}

/// Cameras on a ring around the sphere, with one lens.
fn truth() -> Vec<Camera> {
    let camera = |i: u32| {
        let (sin, cos) = (f64::from(i) * 0.5).sin_cos();
        let eye = SPHERE.center + DVec3::new(4.0 * cos, 1.5 + 0.5 * sin, 4.0 * sin);
        let (focal, middle) = (DVec2::splat(340.0), DVec2::new(160.0, 120.0));
        Camera::look_at(320, 240, focal, middle, eye, SPHERE.center, DVec3::Y).unwrap()
    };
    (0..12).map(camera).collect()
}

/// The same cameras with errors of this many degrees, of as many percent of the distance, and of
/// twice as many percent of the focal length.
fn wrong(size: f64) -> Vec<Camera> {
    let camera = |(i, camera): (u64, &Camera)| {
        let axis = DVec3::from(random(100 + i).in_ball()).normalize();
        let turn = DQuat::from_axis_angle(axis, size.to_radians());
        let [right, up, forward] = [camera.right, camera.up, camera.forward].map(|v| turn * v);
        let shift = DVec3::from(random(200 + i).in_ball()).normalize() * (0.04 * size);
        let (eye, focal) = (camera.eye + shift, camera.focal * (1.0 + 0.02 * size));
        Camera { right, up, forward, eye, focal, ..*camera }
    };
    (0..).zip(&truth()).map(camera).collect()
}

/// Observations by the true cameras of points on the sphere's surface, with errors of up to
/// `noise` pixels; one in ten is off by up to 30 pixels.
fn tracks(noise: f64) -> Vec<Track> {
    let cameras = truth();
    let track = |i: u64| {
        let normal = DVec3::from(random(i).in_ball()).normalize();
        let x = SPHERE.center + normal * SPHERE.radius;
        let of = |(view, camera): (usize, &Camera)| {
            let own = random(1000 + i).at(view as u64);
            let size = if own.at(0).unit() < 0.1 { 30.0 } else { noise };
            let off = DVec2::new(own.at(1).unit() - 0.5, own.at(2).unit() - 0.5) * (2.0 * size);
            let sees = normal.dot(camera.eye - x) > 0.0;
            sees.then(|| Observation { view, u: camera.project(x).unwrap() + off })
        };
        cameras.iter().enumerate().filter_map(of).collect()
    };
    (0..300).map(track).filter(|track: &Track| track.len() > 1).collect()
}

/// The mean angle, in degrees, between the rotations from the first camera to the others and the
/// true ones.
fn rotation_error(cameras: &[Camera]) -> f64 {
    let turn = |a: &Camera, b: &Camera| {
        let pose = |c: &Camera| DMat3::from_cols(c.right, c.up, c.forward);
        pose(a).transpose() * pose(b)
    };
    let truth = truth();
    let pairs = (1..cameras.len()).map(|i| {
        let off = turn(&cameras[0], &cameras[i]) * turn(&truth[0], &truth[i]).transpose();
        DQuat::from_mat3(&off).to_axis_angle().1.to_degrees()
    });
    pairs.sum::<f64>() / (cameras.len() - 1) as f64
}

#[test]
fn wrong_cameras_and_a_wrong_focal_length_become_right() {
    let (given, tracks) = (wrong(0.4), tracks(0.02));
    let before =
        Calibration::new(given.clone(), SPHERE, Freedom::NONE).adjust(&tracks, 1.0, &[true; 12]);
    let mut calibration = Calibration::new(given.clone(), SPHERE, FOCAL);
    let after = calibration.adjust(&tracks, 1.0, &[true; 12]);
    let cameras = calibration.cameras();
    println!("{before:?}, {after:?}, {} {}", rotation_error(&given), rotation_error(&cameras));
    println!("focal length {}", cameras[0].focal.x);
    assert!(before.median > 0.5 && after.median < 0.02, "{before:?}, {after:?}");
    assert_eq!(before.observations, tracks.iter().map(Vec::len).sum::<usize>());
    assert!(rotation_error(&given) > 0.3 && rotation_error(&cameras) < 0.03);
    assert!((cameras[0].focal.x - 340.0).abs() < 0.2, "{}", cameras[0].focal.x);
}

#[test]
fn right_cameras_stay() {
    // Wrong observations that are off by little still pull a little.
    for (noise, median, degrees) in [(0.1, 0.08, 0.05), (0.0, 0.003, 0.01)] {
        let mut calibration = Calibration::new(truth(), SPHERE, FOCAL);
        let after = calibration.adjust(&tracks(noise), 1.0, &[true; 12]);
        let error = rotation_error(&calibration.cameras());
        println!("{noise}: {after:?}, {error}");
        assert!(after.median < median && error < degrees, "{after:?}, {error}");
    }
}

#[test]
fn nothing_seen_changes_nothing() {
    let mut calibration = Calibration::new(wrong(0.4), SPHERE, FOCAL);
    let found = calibration.adjust(&[], 1.0, &[true; 12]);
    assert_eq!(
        found,
        Residuals { observations: 0, median: f64::INFINITY, of_views: vec![f64::INFINITY; 12] }
    );
    assert_eq!(calibration.cameras(), wrong(0.4));
    // Two rays in one direction have no point.
    let one = Observation { view: 0, u: DVec2::new(160.0, 120.0) };
    assert_eq!(calibration.adjust(&[vec![one, one]], 1.0, &[true; 12]).observations, 0);
}

#[test]
fn places_of_a_searched_pixel_that_is_four_pixels_wide_adjust_cameras_as_well() {
    // One place in ten is off by up to 30 pixels, the others by up to 0.4.
    let (given, tracks) = (wrong(0.4), tracks(0.4));
    let [fine, coarse] = [1.0, 4.0].map(|pixel| {
        let mut calibration = Calibration::new(given.clone(), SPHERE, FOCAL);
        calibration.adjust(&tracks, pixel, &[true; 12]);
        rotation_error(&calibration.cameras())
    });
    println!("{fine} {coarse}");
    assert!(coarse < 0.16 && coarse < fine, "{fine} {coarse}");
}

#[test]
fn one_wrong_view_is_found_and_a_view_without_places_stays() {
    let mut given = truth();
    (given[3], given[7]) = (wrong(0.4)[3], wrong(0.4)[7]);
    let seen = |o: &Observation| o.view != 7;
    let tracks: Vec<Track> =
        tracks(0.02).iter().map(|t| t.iter().copied().filter(seen).collect()).collect();
    let before =
        Calibration::new(given.clone(), SPHERE, Freedom::NONE).adjust(&tracks, 1.0, &[true; 12]);
    let mut calibration = Calibration::new(given.clone(), SPHERE, Freedom::POSES);
    let after = calibration.adjust(&tracks, 1.0, &[true; 12]);
    println!("{before:?}, {after:?}");
    assert!(before.of_views[3] > 0.5 && after.of_views[3] < 0.03);
    assert_eq!(after.of_views[7], f64::INFINITY);
    assert!(calibration.corrections()[7].pixels < 0.1, "{:?}", calibration.corrections()[7]);
    let found = Matching::of(&before, &after, &calibration);
    // The median hardly falls. The view that is off is adjusted alone.
    assert!(!found.is_kept, "{found:?}");
    let off = off_views(&before, &after);
    assert_eq!(off, std::array::from_fn::<bool, 12, _>(|view| view == 3));
    let mut alone = Calibration::new(given.clone(), SPHERE, Freedom::POSES);
    let after = alone.adjust(&tracks, 1.0, &off);
    assert!(after.of_views[3] < 0.03);
    for (view, (a, b)) in given.iter().zip(alone.cameras()).enumerate() {
        assert_eq!(*a == b, view != 3, "view {view}");
    }
    let found = Matching::of_views(&before, &after, &alone, &off);
    assert!(found.is_kept && (found.given_off, found.adjusted_off) == (1, 0), "{found:?}");
}
