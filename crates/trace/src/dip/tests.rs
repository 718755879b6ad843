//! Parabolas and kinks whose minima are known.

use super::*;
use approx::assert_relative_eq;
use proptest::prelude::*;

fn point(t: f64, f: f64) -> Point<f64> {
    Point { t, f }
}

fn pair(p: Point<f64>) -> (f64, f64) {
    (p.t, p.f)
}

#[test]
fn a_parabola_has_no_vertex_outside_of_its_points_or_if_it_opens_downwards() {
    // (t − 2)² through points on one side of 2, or with one end there.
    let upwards = |t: f64| point(t, (t - 2.0) * (t - 2.0));
    for [a, b, c] in [[0.0, 1.0, 1.5], [2.0, 3.0, 5.0], [-1.0, 1.0, 2.0], [3.0, 3.5, 4.0]] {
        assert!(vertex(upwards(a), upwards(b), upwards(c)).is_none(), "{a}, {b}, {c}");
    }
    let downwards = |t: f64| point(t, 9.0 - (t - 2.0) * (t - 2.0));
    assert!(vertex(downwards(0.0), downwards(1.0), downwards(4.0)).is_none());
    let line = |t: f64| point(t, 9.0 - t);
    assert!(vertex(line(0.0), line(1.0), line(4.0)).is_none());
    let level = |t: f64| point(t, 1.0);
    assert!(vertex(level(0.0), level(1.0), level(4.0)).is_none());
}

#[test]
fn two_lines_bound_a_kink_by_their_meeting_point() {
    // 3 − 2 (t − 1) and 4 + 3 (t − 5) meet at t = 3.2.
    let bound = line_bound(point(1.0, 3.0), point(5.0, 4.0), -2.0, 3.0);
    assert_relative_eq!(bound.t, 3.2, epsilon = 1e-14);
    assert_relative_eq!(bound.f, -1.4, epsilon = 1e-14);
}

#[test]
fn lines_that_do_not_meet_between_the_ends_give_the_lower_end() {
    let cases = [
        // Both rise, both fall, and one is level: they meet at t = 3, 1, 2 and 2.
        ((0.0, 1.0), (4.0, 7.0), [1.0, 3.0], 0.0),
        ((0.0, 7.0), (4.0, 1.0), [-3.0, -1.0], 4.0),
        ((0.0, 1.0), (4.0, 7.0), [0.0, 3.0], 0.0),
        ((0.0, 7.0), (4.0, 1.0), [-3.0, 0.0], 4.0),
        // They meet before 0, and beyond 4.
        ((0.0, 1.0), (4.0, 20.0), [-1.0, 2.0], 0.0),
        ((0.0, 20.0), (4.0, 1.0), [-2.0, 1.0], 4.0),
    ];
    for (a, b, [slope_a, slope_b], expected) in cases {
        let bound = line_bound(point(a.0, a.1), point(b.0, b.1), slope_a, slope_b);
        assert_eq!(bound.t, expected, "{a:?} {b:?} with {slope_a} and {slope_b}");
        assert_eq!(bound.f, 1.0);
    }
}

/// (t − m)² + c between a and b, with its slope at a.
fn parabola_search(m: f64, c: f64, a: f64, b: f64) -> DipSearch<f64> {
    let at = |t: f64| point(t, (t - m) * (t - m) + c);
    DipSearch::new(at(a), at(b), 2.0 * (a - m), 2.0 * (b - m))
}

#[test]
fn the_first_trial_is_the_vertex_of_the_parabola_kept_off_the_ends() {
    assert_relative_eq!(parabola_search(3.5, 0.2, 2.0, 6.0).trial(), 3.5, epsilon = 1e-14);
    let margin = 4.0 * TRIAL_MARGIN;
    let (left, right) = (parabola_search(2.01, 0.2, 2.0, 6.0), parabola_search(5.9, 0.2, 2.0, 6.0));
    assert_relative_eq!(left.trial(), 2.0 + margin, epsilon = 1e-14);
    assert_relative_eq!(right.trial(), 6.0 - margin, epsilon = 1e-14);
    // The slope of −1 at 2 is flatter than the secant of −2: this parabola opens downwards.
    let downwards = DipSearch::new(point(2.0, 9.0), point(6.0, 1.0), -1.0, 1.0);
    assert_eq!(downwards.trial(), 4.0);
    let line = DipSearch::new(point(2.0, 9.0), point(6.0, 1.0), -2.0, 1.0);
    assert_eq!(line.trial(), 4.0);
    assert_eq!(line.first(), Some(4.0));
}

#[test]
fn a_search_between_neighbouring_numbers_has_no_first_trial() {
    let (from, to) = (1.0, 1.0 + f64::EPSILON);
    assert!(DipSearch::new(point(from, 1.0), point(to, 1.0), -1.0, 1.0).first().is_none());
    let (from, to) = (1.0 + f64::EPSILON, 1.0 + 2.0 * f64::EPSILON);
    assert!(DipSearch::new(point(from, 1.0), point(to, 1.0), -1.0, 1.0).first().is_none());
}

#[test]
fn a_trial_is_new_strictly_between_the_ends_and_off_the_lowest_point() {
    let mut search = parabola_search(3.0, 0.0, 1.0, 5.0);
    search.insert(point(3.5, 0.25));
    for (t, new) in [(1.0, false), (0.5, false), (5.0, false), (6.0, false), (3.5, false)] {
        assert_eq!(search.is_new(t), new, "{t}");
    }
    assert!(search.is_new(1.5) && search.is_new(3.0) && search.is_new(4.5));
}

/// |t − 3| + 1 times 2 on the right: the points that stay enclose 3, and the slopes outside of
/// them are those of the lines.
#[test]
fn inserted_points_move_the_ends_towards_the_minimum() {
    let f = |t: f64| point(t, if t < 3.0 { 4.0 - t } else { 2.0 * t - 5.0 });
    let search = || DipSearch::new(f(0.0), f(9.0), -7.0, 8.0);
    // Two points on the left: the one further away becomes the left end.
    for order in [[1.0, 2.0], [2.0, 1.0]] {
        let mut s = search();
        order.into_iter().for_each(|t| s.insert(f(t)));
        assert_eq!((pair(s.a), pair(s.b)), (pair(f(1.0)), pair(f(9.0))));
        assert_eq!((s.low.map(pair), s.slopes), (Some((2.0, 2.0)), [-1.0, 8.0]));
    }
    // Two points on the right.
    for order in [[3.5, 5.0], [5.0, 3.5]] {
        let mut s = search();
        order.into_iter().for_each(|t| s.insert(f(t)));
        assert_eq!((pair(s.a), pair(s.b)), (pair(f(0.0)), pair(f(5.0))));
        assert_eq!((s.low.map(pair), s.slopes), (Some((3.5, 2.0)), [-7.0, 2.0]));
    }
    // A point above the left end, where the minimum is at or before that end, and one above the
    // right end.
    let rising = |t: f64| point(t, 1.0 + 2.0 * t);
    let mut s = DipSearch::new(rising(1.0), rising(5.0), -1.0, 3.0);
    s.insert(rising(2.0));
    assert_eq!((pair(s.a), pair(s.b), s.low.is_none()), ((1.0, 3.0), (2.0, 5.0), true));
    assert_eq!(s.slopes, [-1.0, 2.0]);
    let falling = |t: f64| point(t, 21.0 - 2.0 * t);
    let mut s = DipSearch::new(falling(1.0), falling(5.0), -3.0, 1.0);
    s.insert(falling(2.0));
    assert_eq!((pair(s.a), pair(s.b), s.low.is_none()), ((2.0, 17.0), (5.0, 11.0), true));
    assert_eq!(s.slopes, [-2.0, 1.0]);
}

#[test]
fn the_last_point_outside_and_the_lowest_point_are_known() {
    let mut s = DipSearch::new(point(1.0, 3.0), point(5.0, 2.0), -3.0, 3.0);
    assert_eq!((pair(s.before(2.0)), pair(s.lowest())), ((1.0, 3.0), (5.0, 2.0)));
    s.insert(point(3.0, 1.0));
    assert_eq!((pair(s.before(2.0)), pair(s.before(4.0))), ((1.0, 3.0), (3.0, 1.0)));
    assert_eq!(pair(s.before(3.0)), (1.0, 3.0));
    assert_eq!(pair(s.lowest()), (3.0, 1.0));
    let s = DipSearch::new(point(1.0, 2.0), point(5.0, 3.0), -3.0, 3.0);
    assert_eq!(pair(s.lowest()), (1.0, 2.0));
}

/// The parabola (t − 1)² through t = 0, 1, 3 has the slopes −2 and 4 at its ends, and secant
/// slopes that differ by 3.
#[test]
fn a_parabola_is_smooth_if_the_slopes_outside_are_steeper() {
    let low = point(1.0, 0.0);
    let smooth = |slopes: [f64; 2]| {
        DipSearch::new(point(0.0, 1.0), point(3.0, 4.0), slopes[0], slopes[1]).is_smooth(low)
    };
    let slack = 3.0 * SLOPE_SLACK;
    assert!(smooth([-2.0, 4.0]) && smooth([-9.0, 9.0]));
    assert!(smooth([-2.0 + 0.99 * slack, 4.0]) && !smooth([-2.0 + 1.01 * slack, 4.0]));
    assert!(smooth([-2.0, 4.0 - 0.99 * slack]) && !smooth([-2.0, 4.0 - 1.01 * slack]));
    assert!(!smooth([-1.0, 2.0]));
    // The same at other distances along the ray, and with a curvature of 2 and end slopes of −4
    // and 8: differences of t and f count, and the curvature does.
    let low = point(11.0, 5.0);
    let smooth = |slopes: [f64; 2]| {
        DipSearch::new(point(10.0, 7.0), point(13.0, 13.0), slopes[0], slopes[1]).is_smooth(low)
    };
    let slack = 2.0 * slack;
    assert!(smooth([-4.0 + 0.99 * slack, 8.0]) && !smooth([-4.0 + 1.01 * slack, 8.0]));
    assert!(smooth([-4.0, 8.0 - 0.99 * slack]) && !smooth([-4.0, 8.0 - 1.01 * slack]));
}

/// Follows a search on `f`, and returns its evaluations.
fn follow(search: &mut DipSearch<f64>, f: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
    let mut seen = Vec::new();
    let mut next = search.first();
    while let Some(t) = next {
        let p = point(t, f(t));
        seen.push(pair(p));
        next = match () {
            () if p.f <= 0.0 => None,
            () => match search.narrow(p) {
                DipStep::Evaluate(t) => Some(t),
                DipStep::NoDip => None,
            },
        };
        assert!(seen.len() <= DIP_EVALUATIONS as usize, "{seen:?}");
    }
    seen
}

/// |t − 3| − 1/2 with one point on it: lines from both sides still allow a negative value.
#[test]
fn a_search_goes_on_while_lines_allow_a_negative_value_and_evaluations_are_left() {
    let f = |t: f64| point(t, (t - 3.0).abs() - 0.5);
    let search = |left: u32| {
        let mut s = DipSearch::new(f(1.0), f(6.0), -1.0, 1.0);
        s.left = left;
        s
    };
    assert!(matches!(search(2).narrow(f(2.0)), DipStep::Evaluate(_)));
    assert!(matches!(search(1).narrow(f(2.0)), DipStep::NoDip));
    // |t − 3| + 1/2 is positive, which its lines show.
    let f = |t: f64| point(t, (t - 3.0).abs() + 0.5);
    assert!(matches!(DipSearch::new(f(1.0), f(6.0), -1.0, 1.0).narrow(f(2.0)), DipStep::NoDip));
    let mut s = search(DIP_EVALUATIONS);
    s.narrow(point(2.0, 0.5));
    assert_eq!(s.left, DIP_EVALUATIONS - 1);
}

/// (t − 3)² + c between 1 and 6, with the lowest point at 3 + shift. The next trial is the vertex,
/// with its prediction, unless it is within a twentieth of 5 or a third trial. Then it is by lines.
#[test]
fn a_vertex_is_tried_if_it_is_far_enough_from_the_lowest_point() {
    let c = 1e-3;
    let f = |t: f64| point(t, (t - 3.0) * (t - 3.0) + c);
    let next = |shift: f64, left: u32| {
        let mut s = DipSearch::new(f(1.0), f(6.0), -4.0, 6.0);
        (s.low, s.left) = (Some(f(3.0 + shift)), left);
        let (t, predicted) = s.next().unwrap_or((f64::NAN, None));
        (predicted.is_some_and(|f| (f - c).abs() < 1e-12), (t - 3.0).abs() < 1e-12)
    };
    let smallest = 5.0 * MIN_VERTEX_SHIFT;
    for sign in [-1.0, 1.0] {
        assert_eq!(next(sign * smallest * 1.01, 14), (true, true));
        assert_eq!(next(sign * smallest * 1.01, 13), (true, true));
        assert_eq!(next(sign * smallest * 0.99, 14), (false, false));
        assert_eq!(next(sign * smallest * 1.01, 15), (false, false));
    }
}

/// A solid without inner points, |t − 3|: a value of 0 is inside, so its tip is looked at.
#[test]
fn a_v_whose_tip_is_exactly_zero_is_followed_to_its_tip() {
    let f = |t: f64| point(t, (t - 3.0).abs());
    let next = DipSearch::new(f(1.0), f(6.0), -1.0, 1.0).narrow(f(2.0));
    assert!(matches!(next, DipStep::Evaluate(3.0)));
}

#[test]
fn a_search_ends_where_no_number_is_left_beside_the_lowest_point() {
    let ulps = |n: f64| 1.0 + n * f64::EPSILON;
    let steep = 40.0 / f64::EPSILON;
    let mut search = DipSearch::new(point(1.0, 1.0), point(ulps(2.0), 1.0), -steep, steep);
    assert!(matches!(search.narrow(point(ulps(1.0), 0.1)), DipStep::NoDip));
}

/// An agreement within [`PREDICTION_TOLERANCE`] of the value ends a search.
#[test]
fn a_search_ends_where_the_prediction_was_good() {
    let f = |t: f64| point(t, (t - 3.0).abs() - 0.5);
    let ends = |predicted: Option<f64>| {
        let mut s = DipSearch::new(f(1.0), f(6.0), -1.0, 1.0);
        s.predicted = predicted;
        matches!(s.narrow(f(2.0)), DipStep::NoDip)
    };
    let (value, share) = (0.5, PREDICTION_TOLERANCE);
    assert!(ends(Some(value)) && !ends(None));
    for sign in [-1.0, 1.0] {
        assert!(ends(Some(value * (1.0 + sign * 0.99 * share))));
        assert!(!ends(Some(value * (1.0 + sign * 1.01 * share))));
    }
}

proptest! {
    #[test]
    fn the_vertex_of_a_parabola_through_three_points_is_its_minimum(
        m in -3.0..3.0f64,
        c in -2.0..2.0f64,
        bend in 0.1..5.0f64,
        left in 0.1..4.0f64,
        right in 0.1..4.0f64,
        middle in 0.05..0.95f64,
    ) {
        let at = |t: f64| point(t, bend * (t - m) * (t - m) + c);
        let (a, b) = (m - left, m + right);
        let Some(v) = vertex(at(a), at(a + (b - a) * middle), at(b)) else {
            return Err(TestCaseError::fail("no vertex"));
        };
        prop_assert!((v.t - m).abs() < 1e-9 && (v.f - c).abs() < 1e-9, "{v:?} for ({m}, {c})");
    }

    /// A V with slopes −s and r: after one point on it, the lines from both sides meet at its tip.
    #[test]
    fn the_second_evaluation_of_a_v_is_its_tip(
        tip in 0.15..0.85f64,
        depth in 1e-6..0.05f64,
        slopes in (0.5..2.0f64, 0.5..2.0f64),
        from in 0.5..3.0f64,
    ) {
        let (s, r) = slopes;
        let tip = from + tip;
        let f = |t: f64| (s * (tip - t)).max(r * (t - tip)) - depth;
        let (a, b) = (point(from, f(from)), point(from + 1.0, f(from + 1.0)));
        prop_assume!(a.f > 0.0 && b.f > 0.0);
        // The slopes outside may be steeper.
        for steeper in [1.0, 1.7] {
            let seen = follow(&mut DipSearch::new(a, b, -s * steeper, r * steeper), f);
            let last = seen[seen.len() - 1];
            prop_assert!(last.1 <= 0.0, "{seen:?}");
            if steeper == 1.0 && seen.len() > 1 {
                prop_assert!(seen.len() == 2 && (last.0 - tip).abs() < 1e-9, "{seen:?}");
            }
        }
    }

    /// The lower bound of a convex f, here the largest of five lines, is below f everywhere.
    #[test]
    fn lines_from_both_sides_of_the_lowest_point_are_below_a_convex_f(
        lines in prop::collection::vec((-3.0..3.0f64, 0.0..1.0f64), 5),
        at in prop::collection::vec(0.05..0.95f64, 1..6),
        away in 0.5..3.0f64,
    ) {
        let f = |t: f64| {
            let x = t - away;
            let line = |(slope, at): &(f64, f64)| slope * (x - at) + 0.3 * slope * slope;
            lines.iter().map(line).fold(f64::MIN, f64::max)
        };
        let p = |t: f64| point(t, f(t));
        let ends = [p(away), p(away + 1.0)];
        let slopes = [(f(away) - f(away - 1e-3)) / 1e-3, (f(away + 1.001) - f(away + 1.0)) / 1e-3];
        let mut search = DipSearch::new(ends[0], ends[1], slopes[0], slopes[1]);
        let lowest = |a: f64, b: f64| {
            (0..=1000).map(|i| f(a + (b - a) * f64::from(i) / 1000.0)).fold(f64::MAX, f64::min)
        };
        for t in at.into_iter().map(|t| away + t) {
            if !search.is_new(t) {
                continue;
            }
            search.insert(p(t));
            let bound = match search.low {
                Some(low) => search.lower_bound(low),
                None => line_bound(search.a, search.b, search.slopes[0], search.slopes[1]),
            };
            let least = lowest(search.a.t, search.b.t);
            prop_assert!(bound.f <= least + 1e-9, "{bound:?} above {least}: {search:?}");
            // Samples 1e-3 apart on lines with slopes of at most 3.
            prop_assert!(least <= lowest(away, away + 1.0) + 3e-3, "the minimum was cut away");
        }
    }

    /// A parabola without negative values, with slopes outside that may be steeper than its own.
    #[test]
    fn the_search_of_a_positive_parabola_ends_early_with_its_lowest_point(
        m in 0.3..0.7f64,
        c in 1e-4..1e-2f64,
        from in 0.5..3.0f64,
    ) {
        let m = from + m;
        let f = |t: f64| (t - m) * (t - m) + c;
        let (a, b) = (point(from, f(from)), point(from + 1.0, f(from + 1.0)));
        let mut search = DipSearch::new(a, b, -3.0, 3.0);
        let seen = follow(&mut search, f);
        prop_assert!(seen.len() < DIP_EVALUATIONS as usize, "{seen:?}");
        prop_assert!(seen.iter().all(|p| p.1 >= search.lowest().f), "{search:?} {seen:?}");
    }
}
