//! Traces a field of one's own, an ellipsoid, and measures the area of its image.

#![allow(clippy::print_stdout, reason = "a program")]

use field::{Field, Sphere};
use glam::DVec3;
use trace::{Options, Outcome, Ray, intersect};

/// f(x) = (x·Ax − 1)/8, with A = diag(1, 4, 1). It has no parameters.
struct Ellipsoid;
const A: DVec3 = DVec3::new(1.0, 4.0, 1.0);
const BOUNDS: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 1.5 };

impl Field<f64> for Ellipsoid {
    fn parameter_count(&self) -> usize {
        0
    }
    fn bounds(&self) -> Option<Sphere<f64>> {
        Some(BOUNDS)
    }
    fn value(&self, x: &[DVec3], f: &mut [f64]) {
        f.iter_mut().zip(x).for_each(|(f, x)| *f = (x.dot(A * x) - 1.0) / 8.0);
    }
    fn value_gradient(&self, x: &[DVec3], f: &mut [f64], gradient: &mut [DVec3]) {
        self.value(x, f);
        gradient.iter_mut().zip(x).for_each(|(g, x)| *g = A * x / 4.0);
    }
    fn hessian_vector(&self, x: &[DVec3], p: &[DVec3], g: &mut [DVec3], product: &mut [DVec3]) {
        self.value_gradient(x, &mut vec![0.0; x.len()], g);
        product.iter_mut().zip(p).for_each(|(product, p)| *product = A * p / 4.0);
    }
    fn parameter_vjp(&self, _: &[DVec3], _: &[f64], _: &[DVec3], _: &mut [f64]) {}
}

fn main() {
    let origin = |i: i32| DVec3::new(f64::from(i % 41 - 20), f64::from(10 - i / 41), 60.0) / 15.0;
    let rays = (0..41 * 21).flat_map(|i| Ray::enter(origin(i), -DVec3::Z, &BOUNDS));
    let (rays, mut found): (Vec<Ray<f64>>, Vec<_>) = (rays.collect(), Vec::new());
    intersect(&Ellipsoid, &rays, &Options::default(), &mut found);
    let hits = found.iter().filter(|found| found.outcome == Outcome::Hit).count();
    println!("area {:.3}, exactly {:.3}", hits as f64 / 225.0, std::f64::consts::FRAC_PI_2);
}
