//! Values and divergences at every point, against finite differences of the independent
//! implementation.

use std::cell::Cell;

use glam::DVec3;
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};
use warp::{Projection, Warp, WarpOptions};

use crate::reference::{Reference, differences};
use crate::scene::{FIELDS, Pinhole, Scene, field};

fn close(found: f64, expected: f64, scale: f64) -> Result<(), TestCaseError> {
    prop_assert!(
        (found - expected).abs() <= 2e-6 * (1.0 + scale),
        "found {found}, expected {expected}, scale {scale}"
    );
    Ok(())
}

/// Checks the values at the points, and that the other points have no weight.
fn check_values(at: &Reference, warp: &Warp<f64>) -> Result<(), TestCaseError> {
    prop_assert_eq!(warp.invalid(), 0);
    for sample in &warp.samples {
        let i = sample.index;
        prop_assert!((sample.x - at.record.x(i)).length() < 1e-12);
        close(sample.weight, at.weight[i], 0.0)?;
        (0..2).try_for_each(|e| close(sample.a[e], at.a[i][e], at.a[i][e].abs()))?;
    }
    let kept = |i: usize| warp.samples.iter().any(|sample| sample.index == i);
    let missed: f64 = (0..at.weight.len()).filter(|i| !kept(*i)).map(|i| at.weight[i]).sum();
    close(missed, 0.0, 0.0)
}

/// Checks ∇·a and b of every sample, and ∇·V. Returns false where finite differences are not
/// possible.
fn check_divergence(scene: &Scene, u: [f64; 2], tangent: &[f64]) -> Result<bool, TestCaseError> {
    let Some(at) = Reference::at(scene, u) else { return Ok(false) };
    let out = scene.warp_with_divergence(&[at.record.ray()]);
    check_values(&at, &out.warp)?;
    let n = at.a.len();
    let Some(da) = differences(scene, u, |r| r.a.iter().flatten().copied().collect()) else {
        return Ok(false);
    };
    let Some(dx) =
        differences(scene, u, |r| (0..n).flat_map(|i| r.record.x(i).to_array()).collect())
    else {
        return Ok(false);
    };
    let Some(dv) = differences(scene, u, |r| r.velocity(scene, tangent).to_vec()) else {
        return Ok(false);
    };
    for (sample, rate) in out.warp.samples.iter().zip(&out.derivatives) {
        let i = sample.index;
        close(
            rate.divergence_a,
            da[0][2 * i] + da[1][2 * i + 1],
            da[0][2 * i].abs() + da[1][2 * i + 1].abs(),
        )?;
        for axis in 0..3 {
            let b = at.a[i][0] * dx[0][3 * i + axis] + at.a[i][1] * dx[1][3 * i + axis];
            close(rate.b.to_array()[axis], b, b.abs())?;
        }
    }
    let x = out.warp.points();
    let (mut f_dot, mut g_dot) = (vec![0.0; x.len()], vec![DVec3::ZERO; x.len()]);
    scene.field.parameter_jvp(&x, tangent, &mut f_dot, &mut g_dot);
    let (v, divergence) = (out.warp.velocity(&f_dot)[0], out.divergence(&f_dot, &g_dot)[0]);
    let expected = at.velocity(scene, tangent);
    (0..2).try_for_each(|e| close(v[e], expected[e], v[e].abs()))?;
    close(divergence, dv[0][0] + dv[1][1], dv[0][0].abs() + dv[1][1].abs())?;
    Ok(true)
}

prop_compose! {
    fn options()(
        steps in 3usize..30,
        top_k in prop_oneof![2usize..10, Just(22), Just(40)],
        gamma in 1.0..8.0f64,
        lambda_d in prop_oneof![Just(0.0), 0.05..1.5f64],
        epsilon in prop_oneof![Just(1e-6), Just(1e-2), 1e-4..0.3f64],
    ) -> WarpOptions {
        WarpOptions { steps, top_k, gamma, lambda_d, epsilon }
    }
}

#[test]
fn values_and_divergences_match_differences() {
    let strategy = (
        (0..FIELDS, prop_oneof![Just(1.0), 0.5..1.0f64], options()),
        prop::array::uniform2(2.0..30.0f64),
        prop::collection::vec(-1.0..1.0f64, 16),
    );
    let (drawn, compared) = (Cell::new(0), Cell::new(0));
    let config =
        ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() };
    let outcome = TestRunner::new_with_rng(
        config,
        TestRng::deterministic_rng(RngAlgorithm::ChaCha),
    )
    .run(&strategy, |((kind, relaxation, options), u, tangent)| {
        let scene = Scene { relaxation, ..Scene::new(field(kind), options) };
        let smooth = check_divergence(&scene, u, &tangent[..scene.field.parameter_count()])?;
        drawn.set(drawn.get() + 1);
        compared.set(compared.get() + usize::from(smooth));
        Ok(())
    });
    outcome.unwrap_or_else(|error| panic!("{error}"));
    // The check must not skip most film positions.
    let (drawn, compared) = (drawn.get(), compared.get());
    println!("{compared} of {drawn} film positions were smooth enough to difference");
    assert!(compared * 2 > drawn, "{compared} of {drawn}");
}

#[test]
fn values_with_and_without_divergence_have_the_same_bits() {
    let scene = Scene::new(field(2), WarpOptions { top_k: 7, ..WarpOptions::IMAGE });
    for i in 0..50 {
        let Some(at) = Reference::at(&scene, [5.0 + 0.4 * f64::from(i), 13.0]) else { continue };
        let ray = [at.record.ray()];
        assert_eq!(scene.warp_with_divergence(&ray).warp, scene.warp(&ray));
    }
}

#[test]
fn second_derivatives_are_evaluated_at_samples_and_at_floors_only() {
    let (top_k, rays) = (6, 12u64);
    let options = WarpOptions { top_k, ..WarpOptions::IMAGE };
    let mut scene = Scene::new(field(0), options);
    let records: Vec<_> = (0..rays).filter_map(|i| scene.record([10.0 + i as f64, 14.0])).collect();
    let counted = field::Counted::new(std::mem::replace(&mut scene.field, field(0)));
    let all: Vec<_> = records.iter().map(|r| r.ray()).collect();
    let out = scene.warp_of_field(&counted, &all);
    let counts = counted.evaluations();
    // One more point per ray is the floor.
    assert_eq!(counts.hessian_vector as usize, 2 * (out.warp.samples.len() + records.len()));
    assert_eq!((counts.value, counts.gradient, counts.parameter), (0, 0, 0));
}

/// Checks the Jacobian of a chart and its derivative against differences of `project`.
fn check_chart(
    chart: &impl Projection<f64>,
    project: impl Fn(DVec3) -> [f64; 2],
    x: DVec3,
) -> Result<(), TestCaseError> {
    let h = 1e-5;
    for axis in DVec3::AXES {
        let (p, q) = (project(x + h * axis), project(x - h * axis));
        let rows = [x + h * axis, x - h * axis].map(|x| chart.jacobian(x));
        for e in 0..2 {
            close(chart.jacobian(x)[e].dot(axis), (p[e] - q[e]) / (2.0 * h), 64.0)?;
            let turned = (rows[0][e] - rows[1][e]) / (2.0 * h);
            close((chart.jacobian_derivative(x, axis)[e] - turned).length(), 0.0, 64.0)?;
        }
    }
    Ok(())
}

proptest! {
    #[test]
    fn charts_match_differences(u in prop::array::uniform2(0.0..32.0f64), t in 1.0..6.0f64) {
        let eye = DVec3::new(0.6, 0.8, 3.6);
        let camera = Pinhole::looking_at_origin(eye);
        let x = camera.eye + t * camera.direction(u);
        (0..2).try_for_each(|e| close(camera.project(x)[e], u[e], 0.0))?;
        check_chart(&camera, |x| camera.project(x), x)?;
        // The crate's own pinhole, through the projection of the independent one.
        let own = warp::Pinhole::looking_at(eye, DVec3::ZERO, DVec3::Y, camera.focal);
        check_chart(&own, |x| camera.project(x), x)?;
        let h = 1e-5;
        for e in 0..2 {
            let moved = |s: f64| {
                let mut u = u;
                u[e] += s;
                camera.direction(u)
            };
            let difference = (moved(h) - moved(-h)) / (2.0 * h);
            close((difference - camera.direction_du(u)[e]).length(), 0.0, 0.0)?;
        }
    }
}
