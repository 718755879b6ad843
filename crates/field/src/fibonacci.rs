//! Directions spread evenly over the sphere.

use glam::DVec3;

/// Direction `i` of `count` on a Fibonacci lattice around the z axis, a unit vector. `azimuth`
/// rotates the lattice about z, in radians.
///
/// Each of the `count` directions stands for an equal share of the sphere's area: z has equal
/// steps, and the azimuth advances by the golden angle.
pub fn fibonacci_direction(i: usize, count: usize, azimuth: f64) -> DVec3 {
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
    let (s, c) = (golden_angle * i as f64 + azimuth).sin_cos();
    DVec3::new(c, s, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z
}
