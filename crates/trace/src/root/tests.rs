//! Brackets of roots with known positions, and answers chosen to make progress slow.

use super::*;
use proptest::prelude::*;

fn bracket(outside: (f64, f64), inside: (f64, f64)) -> Bracket<f64> {
    Bracket::new(point(outside.0, outside.1), point(inside.0, inside.1))
}

fn point(t: f64, f: f64) -> Point<f64> {
    Point { t, f }
}

/// Evaluates `f` until the bracket ends, and returns its widths after every evaluation.
fn refine(bracket: &mut Bracket<f64>, f: impl Fn(u32, f64) -> f64) -> Vec<f64> {
    let mut widths = vec![bracket.inside.t - bracket.outside.t];
    while let Some(t) = bracket.trial(0.0) {
        assert!(t > bracket.outside.t && t < bracket.inside.t, "{t} in {bracket:?}");
        bracket.narrow(point(t, f(widths.len() as u32, t)));
        assert!(bracket.outside.f > 0.0 && bracket.inside.f <= 0.0, "{bracket:?}");
        widths.push(bracket.inside.t - bracket.outside.t);
        assert!(widths.len() <= 300, "the bracket does not end");
    }
    widths
}

#[test]
fn the_root_of_a_line_is_the_first_trial() {
    // 6 − 2t at t = 1 and at t = 5.
    let mut line = bracket((1.0, 4.0), (5.0, -4.0));
    assert_eq!(line.trial(0.0), Some(3.0));
    // 3 − t/2 at t = 2 and at t = 16.
    let mut line = bracket((2.0, 2.0), (16.0, -5.0));
    assert_eq!(line.trial(0.0), Some(6.0));
    line.narrow(point(6.0, 0.0));
    assert_eq!(line.trial(0.0), None);
    assert_eq!((line.best().t, line.best().f), (6.0, 0.0));
}

#[test]
fn the_better_end_has_the_smaller_distance_to_zero() {
    assert_eq!(bracket((1.0, 0.5), (2.0, -0.75)).best().t, 1.0);
    assert_eq!(bracket((1.0, 0.75), (2.0, -0.5)).best().t, 2.0);
}

#[test]
fn a_bracket_ends_where_either_end_is_within_the_tolerance() {
    for (outside, inside) in [(0.25, -1.0), (1.0, -0.25)] {
        let new = || bracket((1.0, outside), (2.0, inside));
        assert_eq!(new().trial(0.25), None);
        assert!(new().trial(0.2).is_some());
    }
}

#[test]
fn a_bracket_ends_where_no_number_is_left_between_its_ends() {
    let ulp = f64::EPSILON;
    // The middle rounds to the left end of the first and to the right end of the second.
    for (from, to) in [(1.0, 1.0 + ulp), (1.0 + ulp, 1.0 + 2.0 * ulp)] {
        assert_eq!(bracket((from, 1.0), (to, -1.0)).trial(0.0), None);
    }
    let middle = bracket((1.0, 1.0), (1.0 + 2.0 * ulp, -1.0)).trial(0.0);
    assert_eq!(middle, Some(1.0 + ulp));
}

#[test]
fn the_middle_follows_where_the_secant_rounds_to_an_end() {
    assert_eq!(bracket((1.0, 1.0), (3.0, -1e-40)).trial(0.0), Some(2.0));
    assert_eq!(bracket((1.0, 1e-40), (3.0, -1.0)).trial(0.0), Some(2.0));
}

/// The weights of the ends that stay, by hand: an end that stays for the second time in a row
/// counts with half of its value, and with its whole value after the other end has stayed.
#[test]
fn an_end_that_stays_twice_counts_half() {
    // In eighths beyond 1.
    let at = |eighths: f64| 1.0 + eighths / 8.0;
    let mut b = bracket((at(0.0), 3.0), (at(8.0), -1.0));
    assert_eq!(b.trial(0.0), Some(at(6.0)));
    b.narrow(point(at(6.0), -1.0));
    assert_eq!(b.trial(0.0), Some(at(4.5)));
    // `outside` stays for the second time: 1.5 against 1.5, the middle.
    b.narrow(point(at(4.5), -1.5));
    assert_eq!(b.trial(0.0), Some(at(2.25)));
    // `inside` has stayed once: its whole value. The width fell from 8 to 2.25 in three
    // evaluations, so there is no bisection.
    b.narrow(point(at(2.25), 4.5));
    assert_eq!(b.trial(0.0), Some(at(2.25 + 2.25 * 0.75)));
    // `inside` stays for the second time: 0.75.
    b.narrow(point(at(3.9375), 2.25));
    assert_eq!(b.trial(0.0), Some(at(3.9375 + 0.5625 * 0.75)));
}

/// Answers that keep the secant near the end that moved last: only bisections help.
#[test]
fn a_bisection_follows_three_evaluations_without_a_halved_width() {
    let mut b = bracket((1.0, 1.0), (2.0, -0.01));
    for n in 1..=3 {
        let t = b.trial(0.0).unwrap_or(f64::NAN);
        assert!(t > 1.9, "{t} at evaluation {n}");
        b.narrow(point(t, -(0.5f64.powi(6 * n))));
    }
    let width = b.inside.t - 1.0;
    assert_eq!(b.trial(0.0), Some(1.0 + 0.5 * width));
}

#[test]
fn a_bracket_ends_after_200_evaluations() {
    // Between 0 and 2^1000 there are enough numbers for a thousand bisections.
    let mut b = bracket((0.0, 1.0), (2f64.powi(1000), -0.01));
    let widths = refine(&mut b, |n, _| -(0.5f64.powi(5 * n as i32)));
    assert_eq!(widths.len(), 201);
}

proptest! {
    /// Roots of r^p − t^p, which is flat on one side of the root and steep on the other.
    #[test]
    fn roots_of_powers_are_found_and_seven_evaluations_halve_the_width(
        r in 0.01..0.99f64,
        p in 1i32..40,
    ) {
        let f = |t: f64| r.powi(p) - t.powi(p);
        let mut b = bracket((0.0, f(0.0)), (1.0, f(1.0)));
        prop_assume!(b.outside.f > 0.0);
        let widths = refine(&mut b, |_, t| f(t));
        prop_assert!(f(b.best().t).abs() <= f(b.outside.t).max(-f(b.inside.t)));
        prop_assert!(b.outside.t <= r + 1e-13 && b.inside.t >= r - 1e-13, "{b:?} for {r}");
        for pair in widths.windows(8) {
            prop_assert!(pair[7] <= pair[0] * 0.5 + 1e-15, "{widths:?}");
        }
    }
}
