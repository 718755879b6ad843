//! Rays along a wide plane.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use field::{Kind, Shape};
use glam::DVec3;
use trace::{Options, Outcome, Ray, intersect};

/// Rays from a height of 1 that meet the plane y = 0 at distances up to 3000.
#[test]
fn rays_above_a_floor_reach_it_far_away() {
    let floor = Shape::<f64>::new(Kind::Plane, &[0.0, 1.0, 0.0, 0.0]);
    let distances = [3.0f64, 30.0, 300.0, 3000.0];
    let rays = distances.map(|distance| {
        let down = -1.0 / distance;
        let direction = DVec3::new((1.0 - down * down).sqrt(), down, 0.0);
        let (origin, near, far) = (DVec3::Y, 0.0, 4000.0);
        Ray { origin, direction, near, far, scale: 1.0, spread: 0.0, reach: f64::INFINITY }
    });
    let mut found = Vec::new();
    intersect(&floor, &rays, &Options::default(), &mut found);
    for (found, distance) in found.iter().zip(distances) {
        assert_eq!(found.outcome, Outcome::Hit, "at {distance}");
        assert!((found.t / distance - 1.0).abs() < 1e-9, "{} at {distance}", found.t);
    }
}

/// With a spread the shortest step grows along the ray, and the ray to the horizon takes fewer.
#[test]
fn a_spread_saves_steps() {
    let floor = Shape::<f64>::new(Kind::Plane, &[0.0, 1.0, 0.0, 0.0]);
    let level = |spread: f64| {
        let (origin, direction, near, far) = (DVec3::Y, DVec3::X, 0.0, 4000.0);
        let ray = Ray { origin, direction, near, far, scale: 1.0, spread, reach: f64::INFINITY };
        let mut found = Vec::new();
        intersect(&floor, &[ray], &Options::default(), &mut found);
        assert_eq!(found[0].outcome, Outcome::Miss);
        found[0].steps
    };
    // Steps of 2 at most without a spread; of t/200 at least with a spread of 1.
    assert!(level(0.0) >= 2000, "{}", level(0.0));
    assert!(level(1.0) <= 200 + 800, "{}", level(1.0));
}
