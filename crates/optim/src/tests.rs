use super::*;
use approx::assert_relative_eq;
use proptest::prelude::*;

fn adam(n: usize) -> Adam<f64> {
    Adam::new(n, vec![Group::new("all", 0..n)])
}

#[test]
fn the_first_step_has_the_size_of_the_rate() {
    let mut p = [1.0, 2.0, 3.0];
    adam(3).step(&mut p, &[0.3, -4.0, 0.0], 0.1).unwrap();
    assert_relative_eq!(p[0], 0.9, epsilon = 1e-7);
    assert_relative_eq!(p[1], 2.1, epsilon = 1e-7);
    assert_relative_eq!(p[2], 3.0);
}

#[test]
fn rosenbrock_is_minimised() {
    let (mut adam, mut p) = (adam(2), [-1.2, 1.0]);
    for i in 0..20_000 {
        let [x, y] = p;
        let gradient = [-2.0 * (1.0 - x) - 400.0 * x * (y - x * x), 200.0 * (y - x * x)];
        adam.step(&mut p, &gradient, 0.01 * 0.9997f64.powi(i)).unwrap();
    }
    assert!((p[0] - 1.0).abs() < 1e-2 && (p[1] - 1.0).abs() < 2e-2, "{p:?}");
}

#[test]
fn groups_have_their_own_rates_and_other_parameters_stay() {
    let mut fast = Group::new("fast", 0..1);
    fast.rate = 10.0;
    let mut adam = Adam::<f64>::new(3, vec![fast, Group::new("slow", 1..2)]);
    let mut p = [0.0; 3];
    adam.step(&mut p, &[1.0; 3], 0.01).unwrap();
    assert_relative_eq!(p[0], -0.1, epsilon = 1e-6);
    assert_relative_eq!(p[1], -0.01, epsilon = 1e-7);
    assert_eq!(p[2], 0.0);
    adam.set_rate("slow", 5.0);
    adam.step(&mut p, &[1.0; 3], 0.01).unwrap();
    assert_relative_eq!(p[0], -0.2, epsilon = 1e-6);
    assert_relative_eq!(p[1], -0.06, epsilon = 1e-6);
}

proptest! {
    /// Kingma and Ba 2015, algorithm 1, without groups.
    #[test]
    fn many_steps_match_the_published_algorithm(
        gradients in prop::collection::vec(-10.0..10.0f64, 1..60),
        rate in 1e-4..1.0f64,
    ) {
        let (mut adam, mut p) = (adam(1), [0.5]);
        let (mut m, mut v, mut q) = (0.0, 0.0, 0.5);
        for (t, g) in gradients.iter().enumerate() {
            adam.step(&mut p, &[*g], rate).unwrap();
            m = 0.9 * m + 0.1 * g;
            v = 0.999 * v + 0.001 * g * g;
            let steps = t as f64 + 1.0;
            let m_hat = m / (1.0 - 0.9f64.powf(steps));
            let v_hat = v / (1.0 - 0.999f64.powf(steps));
            q -= rate * m_hat / (v_hat.sqrt() + 1e-8);
        }
        assert_relative_eq!(p[0], q, epsilon = 1e-9, max_relative = 1e-9);
    }

    #[test]
    fn steps_after_a_restored_state_have_the_same_bits(
        gradients in prop::collection::vec(-1.0..1.0f32, 2..30),
        cut in 1usize..20,
    ) {
        let cut = cut.min(gradients.len() - 1);
        let fresh = || Adam::<f32>::new(1, vec![Group::new("all", 0..1)]);
        let (mut one, mut p) = (fresh(), [0.1f32]);
        gradients.iter().for_each(|g| one.step(&mut p, &[*g], 0.01).unwrap());
        let (mut two, mut q) = (fresh(), [0.1f32]);
        gradients[..cut].iter().for_each(|g| two.step(&mut q, &[*g], 0.01).unwrap());
        let mut three = fresh();
        let (first, second, steps) = two.state();
        three.restore(first, second, steps).unwrap();
        gradients[cut..].iter().for_each(|g| three.step(&mut q, &[*g], 0.01).unwrap());
        prop_assert_eq!(p[0].to_bits(), q[0].to_bits());
    }

    #[test]
    fn a_gradient_of_nan_or_infinity_is_refused_and_changes_nothing(
        poison in prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY]),
        at in 0usize..3,
    ) {
        let (mut adam, mut p) = (adam(3), [1.0, 2.0, 3.0]);
        adam.step(&mut p, &[0.1; 3], 0.1).unwrap();
        let before = (adam.clone(), p);
        let mut gradient = [1.0, 1e30, 1e-310];
        gradient[at] = poison;
        match adam.step(&mut p, &gradient, 0.1) {
            Err(OptimError::NotFinite { index, .. }) => prop_assert_eq!(index, at),
            other => prop_assert!(false, "{other:?}"),
        }
        prop_assert_eq!((adam, p), before);
    }

    #[test]
    fn clipping_keeps_the_direction(
        g in prop::collection::vec(-1e3..1e3f64, 1..20),
        most in 1e-3..10.0f64,
    ) {
        let mut clipped = g.clone();
        let length = clip_norm(&mut clipped, most);
        let expected = g.iter().map(|v| v * v).sum::<f64>().sqrt();
        assert_relative_eq!(length, expected, max_relative = 1e-12);
        prop_assert!(norm(&clipped) <= most * (1.0 + 1e-12) || length <= most);
        for (a, b) in g.iter().zip(&clipped) {
            let (before, after) = (a * norm(&clipped), b * length);
            assert_relative_eq!(before, after, epsilon = 1e-6, max_relative = 1e-9);
        }
    }
}

/// Minimises `Σ h_i (p_i − q_i)²/2` over groups with different rates.
#[test]
fn a_quadratic_is_minimised_to_its_closed_form() {
    let (h, q) = ([0.01, 1.0, 300.0, 7.0], [3.0, -2.0, 0.5, 1e-3]);
    let mut slow = Group::new("slow", 2..4);
    slow.rate = 0.5;
    let mut adam = Adam::<f64>::new(4, vec![Group::new("fast", 0..2), slow]);
    let schedule = Schedule::Exponential { last: 1e-5 };
    let mut p = [0.0; 4];
    for i in 0..8000 {
        let gradient: [f64; 4] = std::array::from_fn(|i| h[i] * (p[i] - q[i]));
        adam.step(&mut p, &gradient, 0.05 * schedule.fraction(f64::from(i) / 8000.0)).unwrap();
    }
    for i in 0..4 {
        assert_relative_eq!(p[i], q[i], epsilon = 1e-5);
    }
}

/// With a zero gradient only the decay acts: p ← p (1 − rate · decay).
#[test]
fn weight_decay_is_decoupled() {
    let mut group = Group::new("all", 0..1);
    group.weight_decay = 0.1;
    let (mut adam, mut p) = (Adam::<f64>::new(1, vec![group]), [2.0]);
    for _ in 0..10 {
        adam.step(&mut p, &[0.0], 0.5).unwrap();
    }
    assert_relative_eq!(p[0], 2.0 * 0.95f64.powi(10), epsilon = 1e-12);
}

/// The floor is in units of the root mean square gradient of the group: with gradients of 1 and ε,
/// it is √(1/2) for a floor of 1 once the moments are those of constant gradients.
#[test]
fn a_floor_makes_the_steps_of_small_gradients_small() {
    let group = Group { beta1: 0.0, beta2: 0.5, floor: 1.0, ..Group::new("all", 0..2) };
    let (mut adam, mut p) = (Adam::<f64>::new(2, vec![group]), [0.0; 2]);
    for _ in 0..60 {
        adam.step(&mut p, &[1.0, 0.01], 0.0).unwrap();
    }
    adam.step(&mut p, &[1.0, 0.01], 1.0).unwrap();
    let floor = 0.5f64.sqrt() * (1.0 + 1e-4f64).sqrt();
    assert_relative_eq!(p[0], -1.0 / (1.0 + floor), epsilon = 1e-9);
    assert_relative_eq!(p[1], -0.01 / (0.01 + floor), epsilon = 1e-9);
}

#[test]
fn single_precision_agrees_with_double_to_2e_5() {
    let mut single = Adam::<f32>::new(1, vec![Group::new("all", 0..1)]);
    let (mut double, mut p, mut q) = (adam(1), [0.5f32], [0.5f64]);
    for i in 0..500 {
        let g = (0.1 * f64::from(i)).sin() + 0.2;
        single.step(&mut p, &[g as f32], 0.01).unwrap();
        double.step(&mut q, &[g], 0.01).unwrap();
    }
    assert_relative_eq!(f64::from(p[0]), q[0], epsilon = 2e-5);
}

/// In single precision the square of 1e30 is infinite: such a step would stop the parameter for
/// ever.
#[test]
fn a_gradient_whose_square_overflows_is_refused() {
    let mut adam = Adam::<f32>::new(2, vec![Group::new("a", 0..1), Group::new("b", 1..2)]);
    let mut p = [0.0f32; 2];
    let error = adam.step(&mut p, &[1.0, -1e30], 0.1).unwrap_err();
    assert!(
        matches!(&error, OptimError::NotFinite { group, index: 1, .. } if group == "b"),
        "{error}"
    );
    assert_eq!((p, adam.state().2), ([0.0; 2], 0));
    for tiny in [1e-30, 1e-45, 0.0, -1e-38] {
        adam.step(&mut p, &[tiny, 1e18], 0.1).unwrap();
        assert!(first_non_finite(&p).is_none() && first_non_finite(adam.state().1).is_none());
    }
}

#[test]
fn a_rate_or_a_state_that_is_not_finite_is_refused() {
    let (mut adam, mut p) = (adam(2), [1.0, 2.0]);
    adam.step(&mut p, &[0.1, 0.2], 0.1).unwrap();
    let before = (adam.clone(), p);
    for poison in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert!(matches!(adam.step(&mut p, &[0.1; 2], poison), Err(OptimError::Rate { .. })));
        assert!(matches!(
            adam.restore(&[0.0, poison], &[0.0; 2], 3),
            Err(OptimError::State { index: 1, .. })
        ));
        assert!(matches!(
            adam.restore(&[0.0; 2], &[poison, 0.0], 3),
            Err(OptimError::State { index: 0, .. })
        ));
    }
    assert!(matches!(
        adam.restore(&[0.0; 2], &[0.0, -1e-9], 3),
        Err(OptimError::State { index: 1, .. })
    ));
    assert_eq!((adam, p), before);
}

#[test]
#[should_panic(expected = "groups [0..3, 2..4] overlap")]
fn overlapping_groups_are_refused() {
    Adam::<f64>::new(4, vec![Group::new("a", 0..3), Group::new("b", 2..4)]);
}

#[test]
#[should_panic(expected = "decay 1 of group all")]
fn a_decay_of_one_is_refused() {
    let mut group = Group::new("all", 0..1);
    group.beta2 = 1.0;
    Adam::<f64>::new(1, vec![group]);
}

#[test]
fn norms_of_very_large_and_small_values_are_right() {
    assert_relative_eq!(norm(&[3e30f32, 4e30]), 5e30, max_relative = 1e-6);
    assert_relative_eq!(norm(&[3e-30f32, 4e-30]), 5e-30, max_relative = 1e-6);
    assert_eq!((norm::<f32>(&[]), norm(&[0.0f32, -0.0])), (0.0, 0.0));
    assert_eq!(norm(&[-3.0f32]), 3.0);
    assert_eq!(norm(&[1.0, f32::NEG_INFINITY]), f32::INFINITY);
    assert!(norm(&[f32::NAN, 1.0]).is_nan());
    assert_eq!(first_non_finite(&[0.0, 1.0f32]), None);
    assert!(norm(&[1.0, f32::NAN]).is_nan());
    assert_eq!(first_non_finite(&[0.0, f32::INFINITY]), Some((1, f32::INFINITY)));
}

#[test]
fn wrong_lengths_are_errors() {
    let mut p = [0.0; 2];
    assert!(matches!(
        adam(3).step(&mut p, &[0.0; 3], 0.1),
        Err(OptimError::Length { what: "parameters", .. })
    ));
    assert!(matches!(adam(3).restore(&[0.0; 2], &[0.0; 3], 1), Err(OptimError::Length { .. })));
}

#[test]
fn a_gradient_is_clipped_only_if_its_norm_is_finite_and_larger() {
    let clipped = |mut gradient: [f64; 2], most: f64| (clip_norm(&mut gradient, most), gradient);
    assert_eq!(clipped([3.0, -4.0], 10.0), (5.0, [3.0, -4.0]));
    assert_eq!(clipped([3.0, -4.0], 2.5), (5.0, [1.5, -2.0]));
    assert_eq!(clipped([3.0, f64::INFINITY], 2.5), (f64::INFINITY, [3.0, f64::INFINITY]));
}

#[test]
fn errors_name_the_group_the_place_and_the_number() {
    let groups = || vec![Group::new("low", 0..2), Group::new("high", 2..5)];
    let mut adam = Adam::<f64>::new(5, groups());
    let mut p = [0.0; 5];
    let error = adam.step(&mut p, &[0.0, 0.0, 0.0, 0.0, 1e200], 0.1).unwrap_err();
    let expected = OptimError::NotFinite { group: String::from("high"), index: 4, value: 1e200 };
    assert_eq!(error, expected);
    let error = adam.step(&mut p, &[0.0; 5], f64::INFINITY).unwrap_err();
    assert_eq!(error, OptimError::Rate { group: String::from("low"), value: f64::INFINITY });
    let error = adam.restore(&[0.0; 5], &[0.0, 0.0, 0.0, -2.5, 0.0], 1).unwrap_err();
    let what = "mean square gradient";
    assert_eq!(error, OptimError::State { what, index: 3, value: -2.5 });
    // A mean gradient may be negative, a mean square may be zero.
    assert_eq!(adam.restore(&[-1.0; 5], &[0.0; 5], 1), Ok(()));
}

#[test]
fn every_slice_of_a_wrong_length_is_named() {
    let mut adam = adam(3);
    let what = |result: Result<(), OptimError>| match result {
        Err(OptimError::Length { what, found, expected }) => Some((what, found, expected)),
        _ => None,
    };
    let step = adam.step(&mut [0.0; 3], &[0.0; 4], 0.1);
    assert_eq!(what(step), Some(("gradient", 4, 3)));
    assert_eq!(what(adam.restore(&[0.0; 2], &[0.0; 3], 1)), Some(("first moments", 2, 3)));
    assert_eq!(what(adam.restore(&[0.0; 3], &[0.0; 2], 1)), Some(("second moments", 2, 3)));
}

#[test]
#[should_panic(expected = "groups [2..5] reach beyond the 4 parameters")]
fn a_group_beyond_the_parameters_is_refused() {
    Adam::<f64>::new(4, vec![Group::new("a", 2..5)]);
}

/// Decoupled weight decay with a factor on the rate: the decay uses the rate of the group. The step
/// of a constant gradient is the rate itself.
#[test]
fn the_decay_of_a_group_is_scaled_by_its_rate() {
    let mut group = Group::new("all", 0..1);
    (group.rate, group.weight_decay) = (3.0, 0.25);
    let (mut adam, mut p) = (Adam::<f64>::new(1, vec![group]), [2.0]);
    adam.step(&mut p, &[1.0], 0.1).unwrap();
    assert_relative_eq!(p[0], 2.0 - 0.3 - 0.3 * 0.25 * 2.0, epsilon = 1e-7);
}

/// Both factors are finite, and their product overflows.
#[test]
fn a_rate_that_overflows_with_the_factor_of_its_group_is_refused() {
    let mut group = Group::new("all", 0..1);
    group.rate = 1e200;
    let (mut adam, mut p) = (Adam::<f64>::new(1, vec![group]), [2.0]);
    let error = adam.step(&mut p, &[1.0], 1e200).unwrap_err();
    assert_eq!(error, OptimError::Rate { group: String::from("all"), value: f64::INFINITY });
    assert_eq!((p, adam.state().2), ([2.0], 0));
}

#[test]
fn the_moments_of_a_parameter_without_a_gradient_end_at_zero() {
    let mut adam = Adam::<f32>::new(2, vec![Group { beta2: 0.9, ..Group::new("all", 0..2) }]);
    let mut p = [0.0; 2];
    adam.step(&mut p, &[1e-3, -1e-3], 0.01).unwrap();
    for _ in 0..2000 {
        adam.step(&mut p, &[0.0, -1e-3], 0.01).unwrap();
    }
    let (first, second, _) = adam.state();
    assert_eq!((first[0], second[0]), (0.0, 0.0));
    assert_relative_eq!(first[1], -1e-3, max_relative = 1e-4);
    assert_relative_eq!(second[1], 1e-6, max_relative = 1e-4);
}

#[test]
fn tall_and_wide_matrices_take_transposed_steps() {
    let entry = |i: usize, j: usize| ((7 * i + 3 * j) % 5) as f64 - 1.7;
    let wide: Vec<f64> = (0..12).map(|i| entry(i / 4, i % 4)).collect();
    let tall: Vec<f64> = (0..12).map(|i| entry(i % 3, i / 3)).collect();
    let stepped = |gradient: &[f64], columns| {
        let mut p = vec![0.0; 12];
        let mut adam = Adam::new(12, vec![Group::matrix("w", 0..12, columns)]);
        adam.step(&mut p, gradient, 0.1).unwrap();
        p
    };
    let (wide, tall) = (stepped(&wide, 4), stepped(&tall, 3));
    for (i, own) in wide.iter().enumerate() {
        approx::assert_relative_eq!(*own, tall[3 * (i % 4) + i / 4], epsilon = 1e-12);
    }
    // The root mean square is a fifth of the rate where all singular values are 1: here three
    // of them lie between 0.7 and 1.3.
    let square = wide.iter().map(|v| v * v).sum::<f64>() / 12.0;
    let expected = 0.1 * 0.2 * (4.0f64 * 3.0 / 12.0).sqrt();
    assert!((0.7..1.3).contains(&(square.sqrt() / expected)), "{wide:?}");
    assert_eq!(stepped(&[0.0; 12], 4), vec![0.0; 12]);
}
