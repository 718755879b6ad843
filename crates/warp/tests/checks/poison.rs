//! Numbers that are not finite, exact ties, and exponents that could overflow.

use field::{Real, Shape, Vector3};
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use warp::{
    Projection, Warp, WarpOptions, WarpWithDivergence, WarpedRay, evaluate,
    evaluate_with_divergence,
};

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

fn finite<R: Real>(out: &WarpWithDivergence<R>) -> bool {
    let sample = |s: &warp::WarpSample<R>| {
        s.weight.is_finite() && s.a.iter().all(|a| a.is_finite()) && s.x.is_finite()
    };
    out.warp.samples.iter().all(sample)
        && out.derivatives.iter().all(|d| d.divergence_a.is_finite() && d.b.is_finite())
}

fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|v| *v as f32).collect()
}

/// The warp of a record that is rounded to single precision.
fn in_single(record: &Record, options: WarpOptions, radius: f64) -> WarpWithDivergence<f32> {
    let (t, f, step) = (single(&record.t), single(&record.f), single(&record.step));
    let gradient: Vec<Vec3> = record.gradient.iter().map(|g| g.as_vec3()).collect();
    let ray = WarpedRay::<f32> {
        origin: record.origin.as_vec3(),
        direction: record.direction.as_vec3(),
        direction_du: record.du.map(|d| d.as_vec3()),
        entry_du: record.entry_du.map(|d| d as f32),
        exit_du: record.exit_du.map(|d| d as f32),
        relaxation: record.relaxation as f32,
        t: &t,
        f: &f,
        gradient: &gradient,
        step: &step,
        clamped: record.clamped,
        valid: true,
    };
    let camera = Pinhole::looking_at_origin(DVec3::new(0.6, 0.8, 3.6));
    let (ball, k) = (Shape::<f32>::sphere([0.05, 0.03, 0.0], radius), options.top_k);
    evaluate_with_divergence(&ball, &options.weighting::<f32>(1.0), k, &[&camera], &[ray])
}

proptest! {
    #[test]
    fn no_exponent_overflows_single_precision(
        u in prop::array::uniform2(2.0..30.0f64),
        gamma in 1.0..64.0f64,
        k in 2usize..26,
        epsilon in prop_oneof![Just(0.0), Just(1e-6), Just(1e-3)],
    ) {
        let options = WarpOptions { top_k: k, gamma, epsilon, ..WarpOptions::IMAGE };
        if let Some(record) = Scene::new(field(0), options).record(u) {
            let out = in_single(&record, options, 0.7);
            prop_assert!(finite(&out) && out.warp.invalid() == 0, "{out:?}");
            let sum: f32 = out.warp.samples.iter().map(|s| s.weight).sum();
            prop_assert!((sum - 1.0).abs() < 1e-4, "{sum}");
        }
    }

    #[test]
    fn single_precision_agrees_with_double(
        u in prop::array::uniform2(8.0..24.0f64),
        k in 3usize..26,
    ) {
        let options =
            WarpOptions { steps: 12, top_k: k, epsilon: 1e-2, ..WarpOptions::IMAGE };
        let scene = Scene::new(field(0), options);
        let Some(record) = scene.record(u) else { return Ok(()) };
        let double = scene.warp_with_divergence(&[record.ray()]);
        let single = in_single(&record, options, 0.7);
        let double_index: Vec<usize> = double.warp.samples.iter().map(|s| s.index).collect();
        let single_index: Vec<usize> = single.warp.samples.iter().map(|s| s.index).collect();
        prop_assume!(double_index == single_index);
        let largest = double.derivatives.iter().fold(1.0f64, |m, d| m.max(d.divergence_a.abs()));
        for (p, (d, s)) in double.warp.samples.iter().zip(&single.warp.samples).enumerate() {
            prop_assert!((d.a[0] - f64::from(s.a[0])).abs() < 1e-2);
            let (d, s) = (double.derivatives[p].divergence_a, single.derivatives[p].divergence_a);
            prop_assert!((d - f64::from(s)).abs() < 2e-2 * largest);
        }
    }

    /// One number of one ray is replaced. Either this ray is not valid and has no samples, or all
    /// its results are finite. The results of the other ray keep their bits.
    #[test]
    fn an_extreme_number_affects_its_own_ray_only(
        kind in 0..FIELDS,
        slot in 0usize..9,
        at in 0usize..64,
        axis in 0usize..3,
        poison in prop::sample::select(vec![
            f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e30, -1e30, 1e-30, 5e-324, 0.0,
        ]),
    ) {
        let options = WarpOptions { top_k: 7, ..WarpOptions::IMAGE };
        let scene = Scene::new(field(kind), options);
        let good = scene.record([15.0, 14.0]).unwrap();
        let mut bad = scene.record([17.3, 20.0]).unwrap();
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
        let alone = scene.warp_with_divergence(&[good.ray()]);
        let both = scene.warp_with_divergence(&[bad.ray(), good.ray()]);
        prop_assert!(finite(&both), "{both:?}");
        let own = both.warp.samples.iter().filter(|s| s.ray == 0).count();
        prop_assert_eq!(both.warp.valid[1], true);
        prop_assert_eq!(both.warp.invalid(), usize::from(!both.warp.valid[0]));
        prop_assert!(both.warp.valid[0] || own == 0);
        if !poison.is_finite() && (slot != 7 || bad.clamped) {
            prop_assert!(!both.warp.valid[0], "slot {slot} took {poison}");
        }
        let a = |samples: &[warp::WarpSample<f64>]| -> Vec<[f64; 2]> {
            samples.iter().map(|s| s.a).collect()
        };
        prop_assert_eq!(a(&both.warp.samples[own..]), a(&alone.warp.samples));
        prop_assert_eq!(&both.derivatives[own..], &alone.derivatives[..]);
    }
}

/// A ray parallel to a plane: f, ∇f·d and Δ have the same bits at all points.
#[test]
fn points_whose_weights_tie_exactly_share_the_weight() {
    let plane = Shape::<f64>::new(field::Kind::Plane, &[0.0, 1.0, 0.0, -0.5]);
    let (t, f, gradient) = ([3.0, 3.5, 4.0, 4.5], [0.5; 4], [DVec3::Y; 4]);
    let ray = |n: usize| WarpedRay {
        origin: DVec3::new(0.0, 0.0, 4.0),
        direction: -DVec3::Z,
        direction_du: [DVec3::X / 64.0, -DVec3::Y / 64.0],
        entry_du: [0.0; 2],
        exit_du: [0.0; 2],
        relaxation: 1.0,
        t: &t[..n],
        f: &f[..n],
        gradient: &gradient[..n],
        step: &f[..n],
        clamped: false,
        valid: true,
    };
    let camera = Pinhole::looking_at_origin(DVec3::new(0.0, 0.0, 4.0));
    for k in 2..6 {
        let weighting = WarpOptions::IMAGE.weighting::<f64>(1.0);
        for n in 1..=4 {
            let out = evaluate_with_divergence(&plane, &weighting, k, &[&camera], &[ray(n)]);
            assert!(finite(&out) && out.warp.invalid() == 0, "k = {k}, n = {n}: {out:?}");
            let sum: f64 = out.warp.samples.iter().map(|s| s.weight).sum();
            assert!((sum - 1.0).abs() < 1e-12, "k = {k}, n = {n}: {sum}");
        }
    }
}

#[test]
fn rays_without_points_or_weights_have_no_warp() {
    let scene = Scene::new(field(0), WarpOptions::IMAGE);
    let empty = Record { origin: DVec3::Z, direction: -DVec3::Z, ..Record::default() };
    let still = Record {
        t: vec![1.0],
        f: vec![0.0],
        gradient: vec![DVec3::Z],
        step: vec![0.0],
        ..empty.clone()
    };
    let rays = [empty.ray(), still.ray()];
    let Warp { samples, valid } = &scene.warp_with_divergence(&rays).warp;
    assert_eq!((samples.len(), valid), (0, &vec![true; 2]));
    assert_eq!(scene.warp(&rays).velocity(&[]), vec![[0.0; 2]; 2]);
    assert!(evaluate::<f64, Pinhole>(&scene.weighting(), 14, &[], &[]).valid.is_empty());
}

#[test]
fn a_gradient_of_zero_gives_finite_numbers() {
    let scene = Scene::new(field(0), WarpOptions::IMAGE);
    for length in [0.0, 1e-200, 5e-324] {
        let mut record = scene.record([15.0, 14.0]).unwrap();
        record.gradient.iter_mut().for_each(|g| *g *= length);
        let kept = scene.warp_with_divergence(&[record.ray()]);
        assert!(finite(&kept), "|∇f| = {length}: {kept:?}");
    }
}

#[test]
fn invalid_options_are_errors_and_the_error_of_one_point_gives_the_reason() {
    let error = WarpOptions { top_k: 1, ..WarpOptions::IMAGE }.validate().unwrap_err();
    assert_eq!(
        error.to_string(),
        "top_k is 1, expected 2 or more: the smallest weight is subtracted, so one point alone \
         keeps none"
    );
    type Change = fn(&mut WarpOptions, f64);
    let fields: [(&str, Change, &[f64]); 3] = [
        ("gamma", |o, v| o.gamma = v, &[0.0, -1.0]),
        ("lambda_d", |o, v| o.lambda_d = v, &[-1.0]),
        ("epsilon", |o, v| o.epsilon = v, &[-1e-6]),
    ];
    for (name, change, wrong) in fields {
        for &value in wrong.iter().chain(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY]) {
            let mut options = WarpOptions::IMAGE;
            change(&mut options, value);
            assert_eq!(options.validate().unwrap_err().name, name, "{value}");
        }
    }
    for steps in [0, 65_537] {
        let options = WarpOptions { steps, ..WarpOptions::IMAGE };
        assert_eq!(options.validate().unwrap_err().name, "steps");
    }
    assert_eq!(WarpOptions::IMAGE.validate().and(WarpOptions::FIT.validate()), Ok(()));
}
