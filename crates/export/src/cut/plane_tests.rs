//! Planes with noise and tilt, of which the parameters are known.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};
use metrics::SurfacePoint;
use random::{Name, Stream, gaussian};

use crate::cut::{Ground, ground};

/// A table of radius 1 with a ball of radius 0.3 on it, tilted by `tilt` degrees about x, with a
/// noise of `noise` (standard deviation) in the heights. Its centre is at (0.3, −0.2, 0.1). Returns
/// the points, and the true normal.
fn table(tilt: f64, noise: f64, on_table: u64) -> (Vec<SurfacePoint>, DVec3) {
    let turn = DQuat::from_rotation_x(tilt.to_radians());
    let stream = Stream::of_seed(7).named(Name::other("points"));
    let point = |i: u64| {
        let [a, b, c] = [0, 1, 2].map(|k| stream.at(i).at(k).unit());
        let (position, normal) = if i < on_table {
            let (radius, angle) = (a.sqrt(), TAU * b);
            let height = noise * gaussian([c, stream.at(i).at(3).unit()])[0];
            (DVec3::new(radius * angle.cos(), radius * angle.sin(), height), DVec3::Z)
        } else {
            let z = 2.0 * a - 1.0;
            let (across, angle) = ((1.0 - z * z).sqrt(), TAU * b);
            let normal = DVec3::new(across * angle.cos(), across * angle.sin(), z);
            (DVec3::Z * 0.3 + 0.3 * normal, normal)
        };
        let position = turn * position + DVec3::new(0.3, -0.2, 0.1);
        SurfacePoint { position, normal: turn * normal }
    };
    ((0..on_table + 4000).map(point).collect(), turn * DVec3::Z)
}

/// The ground of these points of equal area; the cameras are around and above.
fn found(points: &[SurfacePoint], up: DVec3) -> Option<Ground> {
    let eye = |i: u32| DVec3::new(2.0 * f64::from(i).cos(), 2.0 * f64::from(i).sin(), 3.0);
    let eyes: Vec<DVec3> = (0..9).map(eye).collect();
    ground(points, &vec![0.25; points.len()], &eyes, up, 1.0)
}

#[test]
fn a_tilted_noisy_table_is_found_to_its_angle_and_height() {
    for (tilt, noise) in [(0.0, 0.0), (4.0, 0.002), (20.0, 0.004), (40.0, 0.002)] {
        let (points, normal) = table(tilt, noise, 12_000);
        // The sign of the upward direction does not matter.
        for up in [DVec3::Z, DVec3::NEG_Z] {
            let ground = found(&points, up).unwrap();
            let off = ground.plane.normal.dot(normal).min(1.0).acos().to_degrees();
            assert!(off < 0.02, "{tilt}, {noise}: {off} degrees off");
            let height = ground.plane.height(DVec3::new(0.3, -0.2, 0.1));
            assert!(height.abs() < 1e-4 + 0.03 * noise, "{tilt}, {noise}: {height} high");
            assert!((ground.degrees - tilt).abs() < 0.03, "{ground:?}");
            // The ball touches the table: some of it counts too.
            assert!((0.7..0.78).contains(&ground.share), "{ground:?}");
        }
    }
}

#[test]
fn surfaces_without_a_table_have_no_ground() {
    let (tilted, _) = table(50.0, 0.0, 12_000);
    assert_eq!(found(&tilted, DVec3::Z), None);
    // A ball alone, whose flattest parts are caps within 1 % of the radius.
    let (ball, _) = table(0.0, 0.0, 0);
    assert_eq!(found(&ball, DVec3::Z), None);
    // A ball with caps of more than 5 % of its area: nearly all of it is below them.
    let point = |i: usize| {
        let normal = field::fibonacci_direction(i, 4000, 0.0);
        SurfacePoint { position: normal * 0.12, normal }
    };
    assert_eq!(found(&(0..4000).map(point).collect::<Vec<_>>(), DVec3::Z), None);
    // A table alone: nothing is above it, so it is the object.
    let (table_alone, _) = table(0.0, 0.0, 12_000);
    assert_eq!(found(&table_alone[..12_000], DVec3::Z), None);
    // The underside of the table faces away from the cameras.
    let under: Vec<SurfacePoint> =
        table_alone.iter().map(|p| SurfacePoint { normal: -p.normal, ..*p }).collect();
    assert_eq!(found(&under, DVec3::Z), None);
    assert_eq!(found(&[], DVec3::Z), None);
    let nan = [SurfacePoint { position: DVec3::NAN, normal: DVec3::Z }; 9];
    assert_eq!(found(&nan, DVec3::Z), None);
    let line = [0.0, 1.0, 2.0].map(|x| SurfacePoint { position: DVec3::X * x, normal: DVec3::Z });
    assert_eq!(found(&line, DVec3::Z), None);
}
