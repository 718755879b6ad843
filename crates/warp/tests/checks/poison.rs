//! What is not finite, and what ties or overflows.

use field::{Real, Shape, Vector3};
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use warp::{Kept, Options, Projection, WarpedRay, evaluate};

use crate::scene::{FIELDS, Pinhole, Record, Scene, field};

impl Projection<f32> for Pinhole {
    fn jacobian(&self, x: Vec3) -> [Vec3; 2] {
        Projection::<f64>::jacobian(self, x.as_dvec3()).map(|row| row.as_vec3())
    }
    fn jacobian_derivative(&self, x: Vec3, dx: Vec3) -> [Vec3; 2] {
        Projection::<f64>::jacobian_derivative(self, x.as_dvec3(), dx.as_dvec3())
            .map(|row| row.as_vec3())
    }
}

fn finite<R: Real>(kept: &Kept<R>) -> bool {
    kept.a.iter().flatten().chain(&kept.divergence_a).chain(&kept.weight).all(|v| v.is_finite())
        && kept.b.iter().chain(&kept.points).all(|v| v.is_finite())
}

fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|v| *v as f32).collect()
}

/// The kept points of a record rounded to single precision.
fn in_single(record: &Record, options: Options<f64>, radius: f64) -> Kept<f32> {
    let (t, f, step) = (single(&record.t), single(&record.f), single(&record.step));
    let gradient: Vec<Vec3> = record.gradient.iter().map(|g| g.as_vec3()).collect();
    let ray = WarpedRay::<f32> {
        origin: record.origin.as_vec3(),
        direction: record.direction.as_vec3(),
        direction_du: record.du.map(|d| d.as_vec3()),
        entry_du: record.entry_du.map(|d| d as f32),
        exit_du: record.exit_du.map(|d| d as f32),
        t: &t,
        f: &f,
        gradient: &gradient,
        step: &step,
        clamped: record.clamped,
        valid: true,
    };
    let options = Options {
        k: options.k,
        gamma: options.gamma as f32,
        lambda_d: options.lambda_d as f32,
        epsilon: options.epsilon as f32,
        relaxation: options.relaxation as f32,
    };
    let camera = Pinhole::looking_at_origin(DVec3::new(0.6, 0.8, 3.6));
    evaluate(&Shape::<f32>::sphere([0.05, 0.03, 0.0], radius), &options, &[&camera], &[ray], true)
}

proptest! {
    #[test]
    fn no_exponent_overflows_single_precision(
        u in prop::array::uniform2(2.0..30.0f64),
        gamma in 1.0..64.0f64,
        k in 2usize..26,
        epsilon in prop_oneof![Just(0.0), Just(1e-6), Just(1e-3)],
    ) {
        let options = Options { k, gamma, epsilon, ..Options::default() };
        if let Some(record) = Scene::new(field(0), 22, options).record(u) {
            let kept = in_single(&record, options, 0.7);
            prop_assert!(finite(&kept) && kept.invalid == 0, "{kept:?}");
            let sum: f32 = kept.weight.iter().sum();
            prop_assert!((sum - 1.0).abs() < 1e-4, "{sum}");
        }
    }

    #[test]
    fn single_precision_agrees_with_double(u in prop::array::uniform2(8.0..24.0f64), k in 3usize..26) {
        let options = Options { k, epsilon: 1e-2, ..Options::default() };
        let scene = Scene::new(field(0), 12, options);
        let Some(record) = scene.record(u) else { return Ok(()) };
        let double = evaluate(scene.field.as_ref(), &options, &[&scene.camera], &[record.ray()], true);
        let single = in_single(&record, options, 0.7);
        prop_assume!(double.index == single.index);
        let largest = double.divergence_a.iter().fold(1.0f64, |m, d| m.max(d.abs()));
        for p in 0..double.points.len() {
            prop_assert!((double.a[p][0] - f64::from(single.a[p][0])).abs() < 1e-2);
            prop_assert!((double.divergence_a[p] - f64::from(single.divergence_a[p])).abs() < 2e-2 * largest);
        }
    }

    /// One number of one ray is poisoned: that ray contributes nothing and is counted, or
    /// everything stays finite; the other ray keeps its bits.
    #[test]
    fn poison_stays_in_its_ray(
        kind in 0..FIELDS,
        slot in 0usize..9,
        at in 0usize..64,
        axis in 0usize..3,
        poison in prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e30, -1e30, 1e-30, 5e-324, 0.0]),
    ) {
        let scene = Scene::new(field(kind), 22, Options { k: 7, ..Options::default() });
        let (good, mut bad) = (scene.record([15.0, 14.0]).unwrap(), scene.record([17.3, 20.0]).unwrap());
        let at = at % bad.t.len();
        match slot {
            0 => bad.t[at] = poison,
            1 => bad.f[at] = poison,
            2 => bad.gradient[at][axis] = poison,
            3 => bad.step[at] = poison.abs(),
            4 => bad.direction[axis] = poison,
            5 => bad.du[at % 2][axis] = poison,
            6 => bad.entry_du[at % 2] = poison,
            7 => bad.exit_du[at % 2] = poison,
            _ => bad.origin[axis] = poison,
        }
        let alone = evaluate(scene.field.as_ref(), &scene.options, &[&scene.camera], &[good.ray()], true);
        let both = evaluate(scene.field.as_ref(), &scene.options, &[&scene.camera], &[bad.ray(), good.ray()], true);
        prop_assert!(finite(&both), "{both:?}");
        let own: Vec<usize> = (0..both.points.len()).filter(|&p| both.ray[p] == 0).collect();
        prop_assert_eq!(both.valid[1], true);
        prop_assert_eq!(both.invalid, usize::from(!both.valid[0]));
        prop_assert!(both.valid[0] || own.is_empty());
        if !poison.is_finite() && (slot != 7 || bad.clamped) {
            prop_assert!(!both.valid[0], "slot {slot} took {poison}");
        }
        prop_assert_eq!(&both.a[own.len()..], &alone.a[..]);
        prop_assert_eq!(&both.divergence_a[own.len()..], &alone.divergence_a[..]);
    }
}

/// A ray along a plane: f, ∇f·d and Δ are the same at all points, to the last bit.
#[test]
fn exact_ties_share_the_weight() {
    let plane = Shape::<f64>::new(field::Kind::Plane, &[0.0, 1.0, 0.0, -0.5]);
    let (t, f, gradient) = ([3.0, 3.5, 4.0, 4.5], [0.5; 4], [DVec3::Y; 4]);
    let ray = |n: usize| WarpedRay {
        origin: DVec3::new(0.0, 0.0, 4.0),
        direction: -DVec3::Z,
        direction_du: [DVec3::X / 64.0, -DVec3::Y / 64.0],
        entry_du: [0.0; 2],
        exit_du: [0.0; 2],
        t: &t[..n],
        f: &f[..n],
        gradient: &gradient[..n],
        step: &f[..n],
        clamped: false,
        valid: true,
    };
    let camera = Pinhole::looking_at_origin(DVec3::new(0.0, 0.0, 4.0));
    for k in 2..6 {
        let options = Options { k, ..Options::default() };
        for n in 1..=4 {
            let kept = evaluate(&plane, &options, &[&camera], &[ray(n)], true);
            assert!(finite(&kept) && kept.invalid == 0, "k = {k}, n = {n}: {kept:?}");
            let sum: f64 = kept.weight.iter().sum();
            assert!((sum - 1.0).abs() < 1e-12, "k = {k}, n = {n}: {sum}");
        }
    }
}

#[test]
fn rays_without_points_or_weights_have_no_warp() {
    let scene = Scene::new(field(0), 22, Options::default());
    let empty = Record { origin: DVec3::Z, direction: -DVec3::Z, ..Record::default() };
    let still = Record {
        t: vec![1.0],
        f: vec![0.0],
        gradient: vec![DVec3::Z],
        step: vec![0.0],
        ..empty.clone()
    };
    let rays = [empty.ray(), still.ray()];
    let kept = evaluate(scene.field.as_ref(), &scene.options, &[&scene.camera], &rays, true);
    assert_eq!((kept.points.len(), kept.invalid, kept.rays), (0, 0, 2));
    assert_eq!(kept.velocity(&[]), vec![[0.0; 2]; 2]);
    let none = evaluate::<f64, Pinhole>(scene.field.as_ref(), &scene.options, &[], &[], true);
    assert_eq!(none.rays, 0);
}

#[test]
fn a_vanishing_gradient_is_finite() {
    let scene = Scene::new(field(0), 22, Options::default());
    for length in [0.0, 1e-200, 5e-324] {
        let mut record = scene.record([15.0, 14.0]).unwrap();
        record.gradient.iter_mut().for_each(|g| *g *= length);
        let kept =
            evaluate(scene.field.as_ref(), &scene.options, &[&scene.camera], &[record.ray()], true);
        assert!(finite(&kept), "|∇f| = {length}: {kept:?}");
    }
}

#[test]
fn one_point_is_refused_and_the_reason_is_given() {
    let error = Options::<f32> { k: 1, ..Options::default() }.validate().unwrap_err();
    assert_eq!(
        error.to_string(),
        "top_k is 1, expected 2 or more: the shift by the smallest weight leaves one point none"
    );
    type Change = fn(&mut Options<f32>, f32);
    let fields: [(&str, Change, &[f32]); 4] = [
        ("gamma", |o, v| o.gamma = v, &[0.0, -1.0]),
        ("lambda_d", |o, v| o.lambda_d = v, &[-1.0]),
        ("epsilon", |o, v| o.epsilon = v, &[-1e-6]),
        ("relaxation", |o, v| o.relaxation = v, &[0.0, -1.0]),
    ];
    for (name, change, wrong) in fields {
        for &value in wrong.iter().chain(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY]) {
            let mut options = Options::default();
            change(&mut options, value);
            assert_eq!(options.validate().unwrap_err().name, name, "{value}");
        }
    }
    assert_eq!(Options::<f64>::default().validate(), Ok(()));
}
