//! Silhouette points against closed forms and finite differences.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use approx::assert_relative_eq;
use field::{Counted, Csg, Field, Kind, Operation, Real, Shape, Sphere, Vector3};
use glam::DVec3;
use proptest::prelude::*;
use trace::{RayFamily, Start, Tangency, tangencies};

/// Rays in the plane of two orthogonal unit vectors: s is the angle from `ahead` towards `aside`.
struct Plane {
    origin: DVec3,
    ahead: DVec3,
    aside: DVec3,
}

impl<R: Real> RayFamily<R> for Plane {
    fn origin(&self, _: usize) -> R::Vec3 {
        R::Vec3::of(self.origin)
    }
    fn direction(&self, _: usize, s: R) -> (R::Vec3, R::Vec3) {
        let (ahead, aside) = (R::Vec3::of(self.ahead), R::Vec3::of(self.aside));
        let (sin, cos) = s.sin_cos();
        (ahead * cos + aside * sin, aside * cos - ahead * sin)
    }
}

/// The rays from (0, 0, 4) in the plane of −z and `aside`.
fn plane(aside: DVec3) -> Plane {
    let ahead = -DVec3::Z;
    Plane {
        origin: DVec3::new(0.0, 0.0, 4.0),
        ahead,
        aside: aside.reject_from_normalized(ahead).normalize(),
    }
}

fn find<R: Real>(field: &dyn Field<R>, family: &Plane, s: f64) -> Option<Tangency<R>> {
    let start = Start {
        s: R::of(s),
        t: R::of(4.0),
        range: [R::zero(), R::of(0.5)],
        reach: R::of(0.1),
        steepest: R::one(),
    };
    tangencies(field, family, &[start], R::of(1e-6).max(R::epsilon() * R::of(8.0)))[0]
}

fn aside() -> impl Strategy<Value = DVec3> {
    (0.0..std::f64::consts::TAU).prop_map(|angle| DVec3::new(angle.cos(), angle.sin(), 0.0))
}

/// min f along the ray at s, from 40 001 samples around distance 4.
fn lowest(field: &dyn Field<f64>, family: &Plane, s: f64) -> f64 {
    let (d, _) = RayFamily::<f64>::direction(family, 0, s);
    let x: Vec<DVec3> =
        (0..40_001).map(|i| family.origin + d * (3.0 + f64::from(i) * 5e-5)).collect();
    let mut f = vec![0.0; x.len()];
    field.value(&x, &mut f);
    f.into_iter().fold(f64::INFINITY, f64::min)
}

/// A torus, a capsule, a box, or the smooth union of the first two.
fn solid(index: usize) -> Box<dyn Field<f64>> {
    let torus = [0.0, 0.1, 0.0, 0.3, 1.0, 0.6, 0.6, 0.2];
    let torus = || Box::new(Shape::<f64>::new(Kind::Torus, &torus));
    let capsule = [-0.5, 0.0, 0.2, 0.4, 0.3, -0.3, 0.2];
    let capsule = || Box::new(Shape::<f64>::new(Kind::Capsule, &capsule));
    match index {
        0 => torus(),
        1 => capsule(),
        2 => Box::new(Shape::new(Kind::Box, &[0.05, 0.0, 0.0, 0.6, 0.5, 0.4])),
        _ => Box::new(Csg::smooth_union(0.2, vec![torus(), capsule()])),
    }
}

fn value(field: &dyn Field<f64>, x: DVec3) -> f64 {
    let mut f = [0.0];
    field.value(&[x], &mut f);
    f[0]
}

/// Four times the distance to a ball about the origin: |∇f| is 4.
struct SteepBall(f64);

impl Field<f64> for SteepBall {
    fn parameter_count(&self) -> usize {
        0
    }
    fn bounds(&self) -> Option<Sphere<f64>> {
        None
    }
    fn value(&self, x: &[DVec3], f: &mut [f64]) {
        f.iter_mut().zip(x).for_each(|(f, x)| *f = 4.0 * (x.length() - self.0));
    }
    fn value_gradient(&self, x: &[DVec3], f: &mut [f64], g: &mut [DVec3]) {
        self.value(x, f);
        g.iter_mut().zip(x).for_each(|(g, x)| *g = 4.0 * x.normalize());
    }
    fn hessian_vector(&self, _: &[DVec3], _: &[DVec3], _: &mut [DVec3], _: &mut [DVec3]) {}
    fn parameter_vjp(&self, _: &[DVec3], _: &[f64], _: &[DVec3], _: &mut [f64]) {}
}

/// The start at distance 3 along a ray at an angle of 0.1: the cosine between the reversed ray and
/// the direction to that point from the origin is given by the triangle of both and the eye.
#[test]
fn a_search_fails_at_once_where_the_ray_meets_the_surface_too_steeply() {
    let (s, t, eye) = (0.1f64, 3.0, 4.0);
    let distance = (eye * eye + t * t - 2.0 * eye * t * s.cos()).sqrt();
    let cosine = (eye * s.cos() - t) / distance;
    for (steepest, found) in [(cosine * 0.99, false), (cosine * 1.01, true), (1.0, true)] {
        let ball = Counted::new(SteepBall(0.8));
        let start = Start { s, t, range: [0.0, 0.5], reach: 0.1, steepest };
        let tangency = tangencies(&ball, &plane(DVec3::X), &[start], 1e-6)[0];
        assert_eq!(tangency.is_some(), found, "steepest {steepest}");
        assert_eq!(ball.evaluations().gradient == 1, !found);
        if let Some(tangency) = tangency {
            assert_relative_eq!(tangency.s, 0.2f64.asin(), epsilon = 1e-6);
            assert_relative_eq!(tangency.slope, 4.0 * tangency.t, epsilon = 1e-3);
        }
    }
}

proptest! {
    #[test]
    fn the_silhouette_of_a_ball_is_the_tangent_from_the_eye(
        aside in aside(),
        radius in 0.3..1.0f64,
        off in -0.3..0.6f64,
    ) {
        let family = plane(aside);
        let exact = (radius / 4.0).asin();
        let start = exact * (1.0 + off);
        let ball = Counted::new(Shape::<f64>::sphere([0.0; 3], radius));
        let found = find(&ball, &family, start).unwrap();
        assert_relative_eq!(found.s, exact, epsilon = 1e-6);
        assert_relative_eq!(found.t, (16.0 - radius * radius).sqrt(), epsilon = 1e-3);
        // For a distance, ∂m/∂s is the distance t along the ray.
        assert_relative_eq!(found.slope, found.t, epsilon = 1e-3);
        prop_assert!(!found.edge);
        assert_relative_eq!(found.bend * radius, 1.0, epsilon = 0.05);
        prop_assert!(ball.evaluations().gradient <= 24, "{:?}", ball.evaluations());
        let single = find(&Shape::<f32>::sphere([0.0; 3], radius), &family, start).unwrap();
        prop_assert!((f64::from(single.s) - exact).abs() < 1e-5);
    }

    #[test]
    fn tangencies_have_zero_value_and_the_slope_of_the_minimum(
        aside in aside(),
        s in 0.05..0.25f64,
        shape in 0usize..4,
    ) {
        let (field, family) = (solid(shape), plane(aside));
        if let Some(found) = find(&*field, &family, s) {
            let (d, _) = RayFamily::<f64>::direction(&family, 0, found.s);
            let along = found.gradient.dot(d).abs();
            prop_assert!(along < 1e-5 * found.gradient.length().max(1.0));
            let f = value(&*field, family.origin + d * found.t);
            prop_assert!(f.abs() < 1e-4, "f {f}");
            // Where the minimum over all samples is this one, ∂m/∂s is its finite difference.
            let h = 1e-4;
            let lowest = |s| lowest(&*field, &family, s);
            let (plus, minus) = (lowest(found.s + h), lowest(found.s - h));
            let (middle, difference) = (lowest(found.s), (plus - minus) / (2.0 * h));
            let smooth = (plus + minus - 2.0 * middle).abs() < 1e-3 * h;
            if middle.abs() < 1e-6 && smooth {
                let error = (found.slope - difference).abs();
                let (slope, largest) = (found.slope, 2e-2 * difference.abs());
                prop_assert!(error < largest, "{slope} against {difference}");
            }
        }
    }

    #[test]
    fn a_search_finds_the_edge_of_a_box(yaw in 0.3..1.2f64, off in -0.02..0.02f64) {
        // The edge at (0.5, 0.5) of a column, seen from the side at an angle.
        let column = Shape::<f64>::new(Kind::Box, &[0.0, 0.0, 0.0, 0.5, 9.0, 0.5]);
        let eye = DVec3::new(yaw.sin(), 0.0, yaw.cos()) * 4.0;
        let ahead = -eye.normalize();
        let aside = DVec3::Y.cross(-ahead);
        let family = Plane { origin: eye, ahead, aside };
        let edge = DVec3::new(0.5, 0.0, -0.5) - eye;
        let exact = edge.dot(aside).atan2(edge.dot(ahead));
        let found = find(&column, &family, exact + off).unwrap();
        prop_assert!((found.s - exact).abs() < 1e-6, "{} against {exact}", found.s);
        prop_assert!(found.edge);
        // The silhouette moves with the corner: −ḟ/m' for the half size along x is the corner's
        // angular speed.
        let f_dot: f64 = found.points.iter().zip(found.weights).map(|(x, w)| {
            let (mut f, mut g) = ([0.0], [DVec3::ZERO]);
            column.parameter_jvp(&[*x], &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0], &mut f, &mut g);
            w * f[0]
        }).sum();
        let across = aside * exact.cos() - ahead * exact.sin();
        let (speed, corner) = (-f_dot / found.slope, DVec3::X.dot(across) / edge.length());
        prop_assert!((speed - corner).abs() < 1e-3, "{speed} against {corner}");
    }

    #[test]
    fn a_smooth_silhouette_near_a_rim_has_no_weight_on_the_face_behind(
        aside in aside(),
        gap in 3e-4..3e-3f64,
        off in -0.05..0.05f64,
    ) {
        // A ball minus a smaller ball, which the tangent ray enters at a flat angle, `gap` behind
        // the silhouette point.
        let family = plane(aside);
        let exact = 0.2f64.asin();
        let (d, _) = RayFamily::<f64>::direction(&family, 0, exact);
        let touch = family.origin + d * (16.0f64 - 0.64).sqrt();
        let (radius, chord) = (0.3f64, 0.01f64);
        let across = d.cross(touch).normalize();
        let bite = touch + across * (radius * radius - chord * chord).sqrt() + d * (gap + chord);
        let parts: Vec<Box<dyn Field<f64>>> = vec![
            Box::new(Shape::<f64>::sphere([0.0; 3], 0.8)),
            Box::new(Shape::<f64>::sphere(bite.to_array(), radius)),
        ];
        let bitten = Csg::new(Operation::Subtraction, parts);
        // Searches that end elsewhere are not judged: the other end of the rim has a silhouette
        // too, and a search may end between two minima.
        let found = find(&bitten, &family, exact * (1.0 + off))
            .filter(|found| (found.s - exact).abs() < 1e-5);
        let points =
            found.into_iter().flat_map(|found| found.points.into_iter().zip(found.weights));
        for (x, weight) in points {
            let on_the_bite = radius - (x - bite).length() > x.length() - 0.8;
            prop_assert!(!on_the_bite || weight < 1e-3, "a weight of {weight} on the bite");
        }
    }

    #[test]
    fn a_solid_without_inner_points_has_only_its_outline_as_silhouette(
        aside in aside(),
        off in -0.5..0.1f64,
        more in 0.0..1e-7f64,
    ) {
        let family = plane(aside);
        let parts: Vec<Box<dyn Field<f64>>> = vec![
            Box::new(Shape::<f64>::sphere([0.0; 3], 0.8)),
            Box::new(Shape::<f64>::sphere([0.0; 3], 0.8 + more)),
        ];
        let (exact, shell) = (0.2f64.asin(), Csg::new(Operation::Subtraction, parts));
        if let Some(found) = find(&shell, &family, exact * (1.0 + off)) {
            prop_assert!((found.s - exact).abs() < 1e-3, "{} inside of {exact}", found.s);
        }
    }
}
