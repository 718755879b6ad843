//! Rays that skip space by a lattice find what rays without it find, in fewer evaluations.

mod common;

use field::{Counted, Field, Kind, Shape, Sphere};
use glam::DVec3;
use trace::{Intersection, Lattice, Options, Outcome, Ray, intersect_rows};

use common::solids;

const BOUNDS: Sphere<f64> = Sphere { center: DVec3::new(0.1, -0.2, 0.3), radius: 1.5 };

/// The tangent of the angle within which closest approaches matter.
const REACH: f64 = 0.01;

/// A function of a point as a field.
struct Of<F>(F);

impl<F: Fn(DVec3) -> f64 + Send + Sync> Field<f64> for Of<F> {
    fn parameter_count(&self) -> usize {
        0
    }
    fn bounds(&self) -> Option<Sphere<f64>> {
        None
    }
    fn value(&self, x: &[DVec3], f: &mut [f64]) {
        f.iter_mut().zip(x).for_each(|(f, x)| *f = self.0(*x));
    }
    fn value_gradient(&self, x: &[DVec3], f: &mut [f64], _: &mut [DVec3]) {
        self.value(x, f);
    }
    fn hessian_vector(&self, _: &[DVec3], _: &[DVec3], _: &mut [DVec3], _: &mut [DVec3]) {}
    fn parameter_vjp(&self, _: &[DVec3], _: &[f64], _: &[DVec3], _: &mut [f64]) {}
}

/// Rays from a sphere of eyes through points of the bounding ball.
fn rays() -> Vec<Ray<f64>> {
    // Additive recurrence with the powers of the inverse plastic number of dimension 5.
    let step = [0.811_65, 0.658_78, 0.534_69, 0.433_98, 0.352_24];
    let ray = |i: u32| {
        let [a, b, c, d, e] = step.map(|s| (f64::from(i) * s).fract());
        let on_sphere = |a: f64, b: f64| {
            let (z, turn) = (2.0 * a - 1.0, std::f64::consts::TAU * b);
            DVec3::new(turn.cos(), turn.sin(), 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z
        };
        let eye = BOUNDS.center + on_sphere(a, b) * 4.0;
        let through = BOUNDS.center + on_sphere(c, d) * BOUNDS.radius * e.cbrt();
        let ray = Ray::enter(eye, (through - eye).normalize(), &BOUNDS)?;
        Some(Ray { reach: 1.3 * REACH, ..ray })
    };
    (0..20_000).filter_map(ray).collect()
}

fn trace(
    field: &dyn Field<f64>,
    lattice: Option<&Lattice<f64>>,
    rays: &[Ray<f64>],
    relaxation: f64,
) -> (Vec<Intersection<f64>>, u64) {
    let counted = Counted::new(field);
    let mut rows: Vec<_> = rays.iter().map(|ray| (*ray, Intersection::unfinished())).collect();
    let options = Options { relaxation, ..Options::default() };
    intersect_rows(&counted, lattice, &mut rows, |row| Some((&row.0, &mut row.1)), &options);
    (rows.into_iter().map(|row| row.1).collect(), counted.evaluations().value)
}

/// The largest share of closest approaches that may differ: those beside sharp edges and thin wires,
/// and those at the end of an interval.
const OTHER_APPROACHES: f64 = 0.15;

/// Checks the results of all rays with a lattice against those without it. Returns the number of
/// evaluations, relative to that without the lattice.
fn compare(name: &str, field: &dyn Field<f64>, lattice: &Lattice<f64>, relaxation: f64) -> f64 {
    let rays = rays();
    let (expected, before) = trace(field, None, &rays, relaxation);
    let (found, after) = trace(field, Some(lattice), &rays, relaxation);
    let (mut hits, mut near, mut other) = (0u32, 0u32, 0u32);
    for (ray, (found, expected)) in rays.iter().zip(found.iter().zip(&expected)) {
        assert_eq!(found.outcome, expected.outcome, "{name}: {ray:?} {found:?} {expected:?}");
        if expected.outcome == Outcome::Hit {
            hits += 1;
            assert!((found.t - expected.t).abs() < 1e-9, "{name}: {ray:?} {found:?} {expected:?}");
        }
        near += u32::from(expected.clearance < REACH);
        // The parabola through three points gives the clearance beside an edge to a quarter.
        let difference = found.clearance.min(REACH) - expected.clearance.min(REACH);
        other += u32::from(difference.abs() > 0.25 * REACH);
    }
    assert!(hits + near > 100, "{name}: {hits} hits and {near} approaches");
    let share = f64::from(other) / f64::from(near);
    assert!(share <= OTHER_APPROACHES, "{name}: {other} of {near} approaches differ");
    after as f64 / before as f64
}

#[test]
fn hits_and_approaches_are_those_without_a_lattice() {
    for (name, field) in solids() {
        let lattice = Lattice::new(&*field, &BOUNDS);
        let ratio = compare(name, &*field, &lattice, 1.0);
        assert!(ratio < 0.6, "{name}: {ratio} of the evaluations");
    }
}

#[test]
fn fields_that_are_no_distance_keep_their_hits() {
    let torus = Shape::<f64>::new(Kind::Torus, &[0.0, 0.1, 0.0, 0.3, 1.0, 0.2, 0.8, 0.25]);
    let value = |x: DVec3| {
        let mut f = [0.0];
        torus.value(&[x], &mut f);
        f[0]
    };
    let steep = Of(|x| 5.0 * value(x));
    let flat = Of(|x| 0.05 * value(x));
    let bent = Of(|x| value(x) * (1.0 + 0.5 * (4.0 * x.x).sin()));
    let fields: [(_, &dyn Field<f64>, f64); 3] =
        [("steep", &steep, 0.2), ("flat", &flat, 1.0), ("bent", &bent, 0.4)];
    for (name, field, relaxation) in fields {
        compare(name, field, &Lattice::new(field, &BOUNDS), relaxation);
    }
}

#[test]
fn sheets_thinner_than_a_cell_are_not_skipped() {
    for thickness in [0.03, 0.003] {
        let distance = |x: DVec3| DVec3::new(0.3, 0.5, 0.8).normalize().dot(x).abs() - thickness;
        let sheet = Of(distance);
        compare("sheet", &sheet, &Lattice::new(&sheet, &BOUNDS), 1.0);
    }
    // A wire.
    let wire = Of(|x: DVec3| x.cross(DVec3::new(0.6, 0.0, 0.8)).length() - 0.01);
    compare("wire", &wire, &Lattice::new(&wire, &BOUNDS), 1.0);
}

#[test]
fn a_field_that_has_grown_is_seen() {
    // The lattice is that of a smaller ball: rays that skip too far begin inside, and go back.
    let ball = |radius: f64| Shape::<f64>::sphere([0.1, 0.0, -0.2], radius);
    let lattice = Lattice::new(&ball(0.6), &BOUNDS);
    let (rays, grown) = (rays(), ball(0.7));
    let (found, _) = trace(&grown, Some(&lattice), &rays, 1.0);
    for (found, expected) in found.iter().zip(&trace(&grown, None, &rays, 1.0).0) {
        if found.outcome == Outcome::Hit {
            assert!((found.t - expected.t).abs() < 1e-9, "{found:?} {expected:?}");
        }
    }
    // With the change as its drift, no ray misses.
    let ratio = compare("grown", &grown, &lattice.with_drift(0.1), 1.0);
    assert!(ratio < 1.0);
}

/// Solids far smaller than a cell, anywhere in a cell: alone, and beside a large one. Their fields
/// have a kink along all axes at once.
#[test]
fn solids_smaller_than_a_cell_are_hit() {
    let octahedron = |x: DVec3| (x.x.abs() + x.y.abs() + x.z.abs()) / 3f64.sqrt();
    let cube = |x: DVec3| x.abs().max_element();
    let norms: [(&str, &(dyn Fn(DVec3) -> f64 + Send + Sync)); 3] =
        [("ball", &|x| x.length()), ("octahedron", &octahedron), ("cube", &cube)];
    let cell = Lattice::<f64>::cell(&BOUNDS);
    for (name, norm) in norms {
        for i in 0..60 {
            // The middle of a cell first, then other places by an additive recurrence.
            let place = [0.819_17, 0.671_04, 0.549_70].map(|s| (0.5 + f64::from(i) * s).fract());
            let center = BOUNDS.center + (DVec3::from(place) + DVec3::new(3.0, -5.0, 2.0)) * cell;
            for (radius, other) in [(0.2, None), (0.05, None), (0.05, Some(0.4)), (0.01, Some(0.4))]
            {
                let radius = radius * cell;
                let large =
                    |x: DVec3| other.map_or(f64::INFINITY, |r| (x - BOUNDS.center).length() - r);
                let field = Of(|x: DVec3| (norm(x - center) - radius).min(large(x)));
                let lattice = Lattice::new(&field, &BOUNDS);
                let ray = |ray: Ray<f64>| {
                    // Through the solid, and beside it.
                    let through = center + ray.direction.any_orthonormal_vector() * 0.4 * radius;
                    let ray = Ray::enter(ray.origin, (through - ray.origin).normalize(), &BOUNDS)?;
                    Some(Ray { reach: 0.0, ..ray })
                };
                let rays: Vec<Ray<f64>> = rays().into_iter().take(40).filter_map(ray).collect();
                let (expected, _) = trace(&field, None, &rays, 1.0);
                let (found, _) = trace(&field, Some(&lattice), &rays, 1.0);
                for (found, expected) in found.iter().zip(&expected) {
                    let what = format!("{name} of {radius} at {place:?}, other {other:?}");
                    assert_eq!(found.outcome, expected.outcome, "{what}");
                    let is_hit = expected.outcome == Outcome::Hit;
                    assert!(!is_hit || (found.t - expected.t).abs() < 1e-9, "{what}");
                }
            }
        }
    }
}
