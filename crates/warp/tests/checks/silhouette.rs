//! Boundary consistency: at a silhouette, V tends to the velocity of the silhouette as N grows.

use field::{Shape, Sphere};
use glam::DVec3;
use warp::WarpOptions;

use crate::scene::{Pinhole, Scene};

const RADIUS: f64 = 0.7;
const DISTANCE: f64 = 4.0;

/// A ball on the optical axis: its outline on the film is a circle about the principal point.
fn scene(points: usize, gamma: f64) -> Scene {
    let eye = DVec3::new(0.0, 0.0, DISTANCE);
    Scene {
        field: Box::new(Shape::sphere([0.0; 3], RADIUS)),
        camera: Pinhole::looking_at_origin(eye),
        bounds: Sphere { center: DVec3::ZERO, radius: 2.0 },
        options: WarpOptions { steps: points, top_k: points + 1, gamma, ..WarpOptions::IMAGE },
        relaxation: 1.0,
    }
}

/// The outline's radius on the film, F r/√(D² − r²).
fn outline(radius: f64, distance: f64) -> f64 {
    64.0 * radius / (distance * distance - radius * radius).sqrt()
}

/// The error of `V_x` relative to the velocity of the outline, 1e-6 pixels outside the outline, for
/// the derivatives by the centre's x, the centre's z and the radius.
fn errors(points: usize, gamma: f64) -> [f64; 3] {
    let scene = scene(points, gamma);
    let record = scene
        .record([16.0 + outline(RADIUS, DISTANCE) + 1e-6, 16.0])
        .expect("a ray through the bounds");
    let warp = scene.warp(&[record.ray()]);
    let h = 1e-5;
    // Along x the circle becomes an ellipse; its rightmost point moves at F D/(D² − r²).
    let expected = [
        64.0 * DISTANCE / (DISTANCE * DISTANCE - RADIUS * RADIUS),
        (outline(RADIUS, DISTANCE - h) - outline(RADIUS, DISTANCE + h)) / (2.0 * h),
        (outline(RADIUS + h, DISTANCE) - outline(RADIUS - h, DISTANCE)) / (2.0 * h),
    ];
    let parameters = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    std::array::from_fn(|which| {
        let tangent = parameters[which];
        let x = warp.points();
        let n = x.len();
        let (mut f_dot, mut g_dot) = (vec![0.0; n], vec![DVec3::ZERO; n]);
        scene.field.parameter_jvp(&x, &tangent, &mut f_dot, &mut g_dot);
        (warp.velocity(&f_dot)[0][0] - expected[which]).abs() / expected[which].abs()
    })
}

#[test]
fn the_warp_at_a_silhouette_tends_to_the_velocity_of_the_silhouette() {
    println!("relative error of V at the silhouette of a ball, 1e-6 px outside, γ = 3");
    println!("{:>6} {:>10} {:>10} {:>10}", "N", "centre x", "centre z", "radius");
    let table = [22, 64, 200, 600].map(|n| (n, errors(n, 3.0)));
    for (n, [x, z, r]) in &table {
        println!("{n:6} {x:10.4} {z:10.4} {r:10.4}");
    }
    // The largest weights are about 2r/N before the silhouette point, and m is turned by about as
    // much. The error is of first order for motion along the view, and small for the others.
    for (before, after) in table.iter().zip(&table[1..]) {
        let growth = after.0 as f64 / before.0 as f64;
        assert!(after.1[1] < before.1[1] / growth.powf(0.8), "{before:?} {after:?}");
        assert!(after.1.iter().zip(&before.1).all(|(a, b)| a < b), "{before:?} {after:?}");
    }
    assert!(table[3].1.iter().all(|e| *e < 0.05), "{table:?}");
}

#[test]
fn the_warp_is_not_boundary_consistent_for_an_exponent_of_one() {
    let table = [64, 200, 600].map(|n| (n, errors(n, 1.0)));
    println!("the same at γ = 1: {table:.4?}");
    assert!(table[2].1[1] > 10.0 * errors(600, 3.0)[1], "{table:?}");
}
