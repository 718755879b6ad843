//! Settings and their limits, and batches of rays with charts and validity of their own.

use field::Shape;
use glam::DVec3;
use warp::{
    Pinhole, PublishedWeighting, WarpOptions, WarpedRay, evaluate, evaluate_with_divergence,
};

use crate::scene::{Record, Scene, field};

const IMAGE: WarpOptions = WarpOptions::IMAGE;

#[test]
fn settings_at_their_limits_are_valid_and_settings_beyond_are_not() {
    let valid = [
        WarpOptions { steps: 1, ..IMAGE },
        WarpOptions { steps: 65_536, ..IMAGE },
        WarpOptions { top_k: 2, ..IMAGE },
        WarpOptions { gamma: 1e-300, ..IMAGE },
        WarpOptions { gamma: 1e30, lambda_d: 1e30, epsilon: 1e30, ..IMAGE },
        WarpOptions { lambda_d: 0.0, epsilon: 0.0, ..IMAGE },
    ];
    for options in valid {
        assert_eq!(options.validate(), Ok(()), "{options:?}");
    }
    let wrong = [
        (WarpOptions { gamma: 0.0, ..IMAGE }, "gamma", "0"),
        (WarpOptions { gamma: 2e30, ..IMAGE }, "gamma", "2000000000000000000000000000000"),
        (WarpOptions { lambda_d: -0.5, ..IMAGE }, "lambda_d", "-0.5"),
        (WarpOptions { epsilon: -0.25, ..IMAGE }, "epsilon", "-0.25"),
        (WarpOptions { top_k: 0, ..IMAGE }, "top_k", "0"),
    ];
    for (options, name, found) in wrong {
        let error = options.validate().unwrap_err();
        assert_eq!((error.name, error.found.as_str()), (name, found));
    }
    assert_eq!(WarpOptions::default(), IMAGE);
}

#[test]
fn lengths_of_a_weighting_are_in_bounding_radii_and_the_exponent_is_a_number() {
    let options = WarpOptions { gamma: 4.0, lambda_d: 0.5, epsilon: 0.25, ..IMAGE };
    let expected = PublishedWeighting { gamma: 4.0, lambda_d: 1.5, epsilon: 0.75 };
    assert_eq!(options.weighting::<f64>(3.0), expected);
}

/// Three records at different film positions.
fn records(scene: &Scene) -> Vec<Record> {
    [[15.0, 14.0], [17.3, 20.0], [12.0, 18.0]]
        .into_iter()
        .map(|u| scene.record(u).expect("a ray through the bounds"))
        .collect()
}

#[test]
fn a_ray_that_is_not_valid_has_no_samples_and_is_counted() {
    let scene = Scene::new(field(0), WarpOptions { top_k: 7, ..IMAGE });
    let records = records(&scene);
    let mut rays: Vec<WarpedRay<'_, f64>> = records.iter().map(Record::ray).collect();
    rays[1].valid = false;
    for warp in [scene.warp(&rays), scene.warp_with_divergence(&rays).warp] {
        assert_eq!((warp.valid.clone(), warp.invalid()), (vec![true, false, true], 1));
        let of = |ray: usize| warp.samples.iter().filter(|s| s.ray == ray).count();
        assert!(of(0) > 0 && of(1) == 0 && of(2) > 0);
        assert_eq!(warp.points().len(), warp.samples.len());
        assert!(warp.points().iter().zip(&warp.samples).all(|(x, s)| *x == s.x));
    }
}

/// The motion of the end of the interval is an input of rays that reach it, and of no other.
#[test]
fn the_motion_of_the_exit_counts_for_rays_that_reach_it() {
    let scene = Scene::new(field(0), WarpOptions { top_k: 7, ..IMAGE });
    let records = records(&scene);
    for (clamped, valid) in [(false, true), (true, false)] {
        let ray = WarpedRay { clamped, exit_du: [f64::NAN; 2], ..records[0].ray() };
        assert_eq!(scene.warp(&[ray]).valid, [valid], "clamped: {clamped}");
        assert_eq!(scene.warp_with_divergence(&[ray]).warp.valid, [valid], "clamped: {clamped}");
    }
}

/// With half of the focal length, V is half as long.
#[test]
fn every_ray_has_its_own_chart() {
    let scene = Scene::new(field(0), WarpOptions { top_k: 7, ..IMAGE });
    let records = records(&scene);
    let rays: Vec<WarpedRay<'_, f64>> = records.iter().map(Record::ray).collect();
    let chart = |focal| Pinhole::looking_at(scene.camera.eye, DVec3::ZERO, DVec3::Y, focal);
    let (whole, half) = (chart(64.0), chart(32.0));
    let evaluate_with = |charts: &[&Pinhole]| {
        let f: &dyn field::Field<f64> = scene.field.as_ref();
        let both = evaluate_with_divergence(f, &scene.weighting(), 7, charts, &rays);
        assert_eq!(evaluate(&scene.weighting(), 7, charts, &rays), both.warp);
        let f_dot = vec![1.0; both.warp.samples.len()];
        let g_dot = vec![DVec3::X; f_dot.len()];
        (both.warp.velocity(&f_dot), both.divergence(&f_dot, &g_dot))
    };
    let (all, mixed) = (evaluate_with(&[&whole]), evaluate_with(&[&whole, &half, &whole]));
    assert_eq!(evaluate_with(&[&whole; 3]), all);
    assert_eq!((mixed.0[0], mixed.1[0]), (all.0[0], all.1[0]));
    assert_eq!((mixed.0[2], mixed.1[2]), (all.0[2], all.1[2]));
    assert_eq!(mixed.0[1], all.0[1].map(|v| 0.5 * v));
    assert_eq!(mixed.1[1], 0.5 * all.1[1]);
}

#[test]
#[should_panic(expected = "2 charts for 3 rays")]
fn two_charts_for_three_rays_are_refused() {
    let scene = Scene::new(field(0), IMAGE);
    let records = records(&scene);
    let rays: Vec<WarpedRay<'_, f64>> = records.iter().map(Record::ray).collect();
    evaluate(&scene.weighting(), 7, &[&scene.camera; 2], &rays);
}

/// Points of a ray parallel to a plane have one density, so weights are lengths: with the floor
/// subtracted they are 3, 1 and 2 of 6.
#[test]
fn weights_are_lengths_less_the_smallest_where_the_density_is_the_same() {
    let plane = Shape::<f64>::new(field::Kind::Plane, &[0.0, 1.0, 0.0, -0.5]);
    let (t, step) = ([3.0, 3.5, 4.0, 4.5, 5.0], [0.5, 0.25, 0.125, 0.375, 0.0625]);
    let ray = WarpedRay {
        origin: DVec3::new(0.0, 0.0, 4.0),
        direction: -DVec3::Z,
        direction_du: [DVec3::X / 64.0, -DVec3::Y / 64.0],
        entry_du: [0.0; 2],
        exit_du: [0.0; 2],
        relaxation: 1.0,
        t: &t,
        f: &[0.5; 5],
        gradient: &[DVec3::Y; 5],
        step: &step,
        clamped: false,
        valid: true,
    };
    let camera = Pinhole::looking_at(ray.origin, DVec3::ZERO, DVec3::Y, 64.0);
    let weighting = IMAGE.weighting::<f64>(1.0);
    let weights = |k: usize| {
        let out = evaluate_with_divergence(&plane, &weighting, k, &[&camera], &[ray]);
        assert_eq!(out.warp.invalid(), 0);
        out.warp.samples.iter().map(|s| (s.index, s.weight)).collect::<Vec<_>>()
    };
    let expect = |k: usize, expected: &[(usize, f64)]| {
        let found = weights(k);
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (found, expected) in found.iter().zip(expected) {
            assert_eq!(found.0, expected.0);
            assert!((found.1 - expected.1).abs() < 1e-12, "{found:?} {expected:?}");
        }
    };
    // The four longest, less 1/8: 3/8, 1/8 and 2/8.
    expect(4, &[(0, 3.0 / 6.0), (1, 1.0 / 6.0), (3, 2.0 / 6.0)]);
    expect(2, &[(0, 1.0)]);
    // All five, less 1/16: 7, 3, 1 and 5 of 16.
    expect(5, &[(0, 7.0 / 16.0), (1, 3.0 / 16.0), (2, 1.0 / 16.0), (3, 5.0 / 16.0)]);
    // Fewer points than k: nothing is subtracted, and the lengths are 8, 4, 2, 6 and 1 of 21.
    let shares = [8.0, 4.0, 2.0, 6.0, 1.0].map(|length| length / 21.0);
    expect(6, &std::array::from_fn::<_, 5, _>(|i| (i, shares[i])));
}
