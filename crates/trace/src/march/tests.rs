//! Steps and decisions along rays on which f is a line, a parabola or a kink.

use super::*;
use crate::intersect::intersect;
use approx::assert_relative_eq;
use field::{Field, Sphere};
use glam::DVec3;
use proptest::prelude::*;

fn point(t: f64, f: f64) -> Point<f64> {
    Point { t, f }
}

/// f as a function of the distance along rays from the origin in the direction +x.
struct Along<F>(F);

impl<F: Fn(f64) -> f64 + Send + Sync> Field<f64> for Along<F> {
    fn parameter_count(&self) -> usize {
        0
    }
    fn bounds(&self) -> Option<Sphere<f64>> {
        None
    }
    fn value(&self, x: &[DVec3], f: &mut [f64]) {
        f.iter_mut().zip(x).for_each(|(f, x)| *f = self.0(x.x));
    }
    fn value_gradient(&self, x: &[DVec3], f: &mut [f64], _: &mut [DVec3]) {
        self.value(x, f);
    }
    fn hessian_vector(&self, _: &[DVec3], _: &[DVec3], _: &mut [DVec3], _: &mut [DVec3]) {}
    fn parameter_vjp(&self, _: &[DVec3], _: &[f64], _: &[DVec3], _: &mut [f64]) {}
}

fn ray(near: f64, far: f64, scale: f64) -> Ray<f64> {
    Ray {
        origin: DVec3::ZERO,
        direction: DVec3::X,
        near,
        far,
        scale,
        spread: 0.0,
        reach: f64::INFINITY,
    }
}

fn trace(near: f64, far: f64, f: impl Fn(f64) -> f64 + Send + Sync) -> Intersection<f64> {
    trace_with(ray(near, far, 2.0), &Options::default(), f)
}

fn trace_with(
    ray: Ray<f64>,
    options: &Options<f64>,
    f: impl Fn(f64) -> f64 + Send + Sync,
) -> Intersection<f64> {
    let mut out = Vec::new();
    intersect(&Along(f), &[ray], options, &mut out);
    out[0]
}

/// Calls `act` with a tracer of a ray of the given interval and scale. The shortest step is 0.01.
fn with_tracer<T>(
    (near, far, scale): (f64, f64, f64),
    act: impl FnOnce(&mut Tracer<'_, f64>, &mut RayState<f64>) -> T,
) -> (T, Intersection<f64>) {
    let (ray, options, mut found) =
        (ray(near, far, scale), Options::default(), Intersection::unfinished());
    let mut tracer =
        Tracer { ray: &ray, options: &options, lattice: None, min_step: 0.01, found: &mut found };
    let result = act(&mut tracer, &mut RayState::new(near, &options));
    (result, found)
}

#[test]
fn the_first_step_is_bounded_by_the_scale_and_by_the_interval() {
    let first = |interval| with_tracer(interval, |tracer, _| tracer.first_step()).0;
    assert_eq!(first((3.0, 103.0, 2.0)), 2.0 * FIRST_STEP_PER_SCALE);
    assert_eq!(first((3.0, 4.0, 20.0)), FIRST_STEP_PER_INTERVAL);
}

#[test]
fn the_steepest_slope_starts_at_the_reciprocal_of_the_relaxation() {
    let options = Options { relaxation: 0.25, ..Options::default() };
    assert_eq!(RayState::new(3.0, &options).steepest, 4.0);
}

/// Balls of radius f/L about both ends of a chord of length 1.
#[test]
fn balls_touch_if_their_radii_reach_from_end_to_end() {
    let touch = |last: f64, here: f64, steepest: f64| {
        let act = |tracer: &mut Tracer<'_, f64>, s: &mut RayState<f64>| {
            s.steepest = steepest;
            (tracer.balls_touch(s, point(3.0, last), point(4.0, here)), s.steepest)
        };
        with_tracer((3.0, 9.0, 2.0), act).0
    };
    let edge = 1.0 - TOUCH_SLACK;
    assert_eq!(touch(0.6, edge - 0.6 + 1e-6, 1.0), (true, 1.0));
    assert_eq!(touch(0.6, edge - 0.6 - 1e-6, 1.0), (false, 1.0));
    // With L = 2 the same values are too small by half.
    assert!(!touch(0.6, 0.6, 2.0).0 && touch(1.1, 0.9, 2.0).0);
    // A negative end has a ball inside of the solid.
    assert!(touch(0.6, -0.5, 1.0).0);
    // The chord itself is steeper than L.
    assert_eq!(touch(0.5, 3.5, 1.0), (true, 3.0));
    assert_eq!(touch(4.5, 0.5, 1.0), (true, 4.0));
}

#[test]
fn a_chord_below_half_of_the_shortest_step_does_not_change_the_steepest_slope() {
    for (width, expected) in [(0.0049, 1.0), (0.0051, 10.0)] {
        let act = |tracer: &mut Tracer<'_, f64>, s: &mut RayState<f64>| {
            tracer.balls_touch(s, point(3.0, 1.0), point(3.0 + width, 1.0 + 10.0 * width));
            s.steepest
        };
        assert_relative_eq!(with_tracer((3.0, 9.0, 2.0), act).0, expected, epsilon = 1e-9);
    }
}

#[test]
fn a_step_is_taken_back_to_the_end_of_the_empty_ball_and_at_most_to_the_middle() {
    let back = |f: f64, steepest: f64| {
        let act = |tracer: &mut Tracer<'_, f64>, s: &mut RayState<f64>| {
            s.steepest = steepest;
            assert!(tracer.step_back(s, point(3.0, f), point(5.0, 0.1)));
            s.t
        };
        with_tracer((3.0, 9.0, 2.0), act).0
    };
    assert_eq!(back(1.0, 2.0), 3.5);
    assert_eq!(back(6.0, 2.0), 4.0);
    assert_eq!(back(1e-9, 2.0), 3.01);
}

/// f = f₀ + σ Δt: after a step d the balls at both ends touch if f₀ + f₀ + σ d = L d.
#[test]
fn over_relaxed_steps_end_where_the_balls_would_just_touch() {
    for (steepest, f, slope) in
        [(2.0, 4.0, 1.0), (1.0, 0.3, 0.5), (3.0, 2.0, -0.5), (1.0, 2.0, 0.2)]
    {
        let (last, here) = (point(2.0, f - 3.0 * slope), point(5.0, f));
        let radius = f / steepest;
        let touching = 2.0 * f / (steepest - slope);
        let step = touching_step(steepest, radius, last, here);
        assert_relative_eq!(step, TOUCHING_STEP * touching, epsilon = 1e-12);
    }
    // Falling as steeply as f can, a step is one radius; rising so, the longest step.
    assert_eq!(touching_step(2.0, 2.0, point(4.0, 6.0), point(5.0, 4.0)), 2.0);
    assert_eq!(touching_step(2.0, 2.0, point(4.0, 2.0), point(5.0, 4.0)), 2.0 * LONGEST_STEP);
}

#[test]
fn the_expected_root_is_that_of_the_line_or_of_the_parabola() {
    let root = |before: Option<f64>, last: f64, here: f64, f: fn(f64) -> f64| {
        let at = |t: f64| point(t, f(t));
        expected_root(before.map(at), at(last), at(here))
    };
    // 9 − 2t from t = 2: the root is at 4.5.
    let line = |t: f64| 9.0 - 2.0 * t;
    assert_relative_eq!(root(None, 1.5, 2.0, line).unwrap_or(0.0), 2.5, epsilon = 1e-12);
    assert_relative_eq!(root(Some(0.25), 1.5, 2.0, line).unwrap_or(0.0), 2.5, epsilon = 1e-12);
    // Opening upwards with the first root at 3, and opening downwards with its root at 3.
    let upwards = |t: f64| (t - 3.0) * (t - 7.0);
    assert_relative_eq!(root(Some(0.25), 0.5, 2.0, upwards).unwrap_or(0.0), 1.0, epsilon = 1e-12);
    let downwards = |t: f64| 2.0 * (3.0 - t) * (t + 5.0);
    assert_relative_eq!(root(Some(0.25), 0.5, 2.0, downwards).unwrap_or(0.0), 1.0, epsilon = 1e-12);
    // f rises; the parabola stays above zero; its roots lie behind.
    assert!(root(None, 1.0, 2.0, |t| t).is_none());
    assert!(root(None, 1.0, 2.0, |_| 1.0).is_none());
    assert!(root(Some(0.0), 0.5, 2.0, |t| (t - 3.0) * (t - 3.0) + 1.0).is_none());
    assert!(root(Some(-2.0), -1.0, 2.0, |t| (t - 1.0) * (t - 1.0) - 0.5).is_none());
}

#[test]
fn a_minimum_between_three_points_is_the_closest_approach() {
    // (t − 3)² + 0.1, with its minimum at 3 and a clearance of 0.1/(2 · 3).
    let at = |t: f64| point(t, (t - 3.0) * (t - 3.0) + 0.1);
    let note = |before: Option<Point<f64>>, last: Point<f64>, here: Point<f64>| {
        let act = |tracer: &mut Tracer<'_, f64>, s: &mut RayState<f64>| {
            s.steepest = 2.0;
            tracer.note_minimum(s, before, last, here);
        };
        with_tracer((1.0, 9.0, 2.0), act).1
    };
    let found = note(Some(at(2.0)), at(2.9), at(4.5));
    assert_relative_eq!(found.nearest, 3.0, epsilon = 1e-12);
    assert_relative_eq!(found.t, 3.0, epsilon = 1e-12);
    assert_relative_eq!(found.f, 0.1, epsilon = 1e-12);
    assert_relative_eq!(found.clearance, 0.1 / 6.0, epsilon = 1e-12);
    // No minimum: only one neighbour, or one neighbour that is lower.
    let none = Intersection::unfinished();
    assert_eq!(note(None, at(2.9), at(4.5)), none);
    assert_eq!(note(Some(at(2.8)), at(4.0), at(4.5)), none);
    assert_eq!(note(Some(at(2.0)), at(2.5), at(3.2)), none);
    // A vertex below zero is no value of f: the middle point counts.
    let found = note(Some(point(1.0, 1.0)), point(2.9, 0.001), point(3.0, 1.0));
    assert_eq!((found.nearest, found.f), (2.9, 0.001));
}

#[test]
fn the_smallest_clearance_and_the_lowest_point_are_kept_apart() {
    let ((), found) = with_tracer((1.0, 90.0, 2.0), |tracer, _| {
        // Clearances of 0.1, 0.05 and 0.08: the second is the smallest, the third the lowest.
        for p in [point(4.0, 0.8), point(20.0, 2.0), point(2.5, 0.4)] {
            tracer.note_approach(p, 2.0);
        }
    });
    assert_relative_eq!(found.clearance, 0.05, epsilon = 1e-12);
    assert_eq!((found.nearest, found.t, found.f), (20.0, 2.5, 0.4));
}

/// Along a ray that falls at slope 1: the start, one first step, one step across the root, and the
/// root of the line.
#[test]
fn a_plane_ahead_takes_four_evaluations() {
    for root in [4.9, 5.0, 5.3] {
        let found = trace(3.0, 9.0, |t| root - t);
        assert_eq!((found.outcome, found.steps), (Outcome::Hit, 4), "{found:?}");
        assert_relative_eq!(found.t, root, epsilon = 1e-12);
    }
}

/// f = 1 at all points, and slopes of up to 1/ρ are expected: balls have the radius ρ. After a
/// first step of one radius, each step is 0.95 times the 2ρ at which balls touch. The ray ends at
/// the first point with less than a radius left.
#[test]
fn a_ray_beside_a_plane_takes_steps_of_nearly_two_radii() {
    for (far, relaxation) in [(9.0, 1.0), (20.0, 1.0), (33.3, 1.0), (20.0, 0.5), (9.1, 0.3)] {
        let options = Options { relaxation, ..Options::default() };
        let found = trace_with(ray(3.0, far, 2.0), &options, |_| 1.0);
        let left = far - 3.0 - 2.0 * relaxation;
        let expected = 2 + (left / (2.0 * TOUCHING_STEP * relaxation)).ceil() as u32;
        assert_eq!((found.outcome, found.steps), (Outcome::Miss, expected), "to {far}");
        assert_eq!(found.f, 1.0);
    }
}

#[test]
fn a_ray_ends_at_a_value_that_is_not_finite_and_at_a_start_inside() {
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let found = trace(3.0, 9.0, |t| if t > 3.5 { value } else { 2.0 });
        assert_eq!((found.outcome, found.steps), (Outcome::Invalid, 2));
        assert!(found.t > 3.5);
    }
    for value in [0.0, -1.0] {
        let found = trace(3.0, 9.0, |_| value);
        assert_eq!((found.outcome, found.t, found.steps), (Outcome::Inside, 3.0, 1));
        assert_eq!(found.f, value);
    }
}

/// A value is an answer even at the step limit: a hit is found, and a miss keeps its lowest point.
#[test]
fn the_step_limit_ends_a_ray_at_its_lowest_point() {
    for step_limit in [1, 2, 5] {
        let options = Options { step_limit, ..Options::default() };
        let found = trace_with(ray(3.0, 1000.0, 100.0), &options, |t| 1.0 + 0.01 * (5.0 - t).abs());
        assert_eq!((found.outcome, found.steps), (Outcome::Miss, step_limit));
        assert!(found.f < 1.03 && found.f >= 1.0, "{found:?}");
    }
    // The first step crosses the root, and it is the last evaluation of the march.
    let options = Options { step_limit: 2, ..Options::default() };
    let found = trace_with(ray(3.0, 9.0, 2.0), &options, |t| 1.0 - 10.0 * (t - 3.0));
    assert_eq!(found.outcome, Outcome::Hit);
    assert_relative_eq!(found.t, 3.1, epsilon = 1e-12);
}

/// A tolerance in units of the scale: the root of a line with a kink is accepted at the first value
/// within it.
#[test]
fn the_tolerance_of_a_root_is_in_units_of_the_scale() {
    let f = |t: f64| (5.0 - t) * (1.0 + 0.3 * (t - 5.0));
    for scale in [0.5, 2.0, 50.0] {
        for tolerance in [1e-3, 1e-6, 1e-9] {
            let options = Options { tolerance, ..Options::default() };
            let found = trace_with(ray(3.0, 9.0, scale), &options, f);
            assert_eq!(found.outcome, Outcome::Hit);
            assert!(found.f.abs() <= tolerance * scale, "{found:?} at {tolerance} of {scale}");
        }
    }
    let steps = |scale| {
        let options = Options { tolerance: 1e-3, ..Options::default() };
        trace_with(ray(3.0, 9.0, scale), &options, f).steps
    };
    // With a tolerance as large as f everywhere, the crossing is the hit.
    assert!(steps(2000.0) < steps(2.0));
}

#[test]
fn a_crossing_of_the_far_end_is_no_hit() {
    // The root at 9.5 lies behind the interval, and f is 0.5 at its end.
    let found = trace(3.0, 9.0, |t| 9.5 - t);
    assert_eq!(found.outcome, Outcome::Miss);
    assert!(found.f >= 0.5 && found.t < 9.0 && found.steps < 8, "{found:?}");
    // A rising f is lowest at the start.
    let found = trace(3.0, 9.0, |t| t - 2.5);
    assert_eq!((found.outcome, found.t, found.f), (Outcome::Miss, 3.0, 0.5));
}

proptest! {
    /// A slab between two planes, seen at any angle: f falls to the first face and rises behind the
    /// middle. The hit is the first face.
    #[test]
    fn a_slab_is_hit_at_its_first_face(
        face in 3.1..8.0f64,
        width in 1e-3..0.5f64,
        cosine in 0.02..1.0f64,
    ) {
        let f = |t: f64| cosine * ((t - face - 0.5 * width).abs() - 0.5 * width);
        let found = trace(3.0, 9.0, f);
        prop_assert_eq!(found.outcome, Outcome::Hit);
        prop_assert!((found.t - face).abs() * cosine < 1e-13, "{:?} for {}", found, face);
        prop_assert!(found.steps < 120, "{found:?}");
    }

    /// Two balls on one side of the ray: the nearest approach and the clearance are those of the
    /// ball that the ray passes at the smaller angle, f(t)/t.
    #[test]
    fn clearance_is_the_smallest_ratio_of_gap_and_distance(
        at in (4.0..5.0f64, 7.0..8.0f64),
        gap in 0.05..0.2f64,
        factor in prop_oneof![0.3..0.7f64, 1.5..3.0f64],
    ) {
        let gaps = (gap, gap * factor * at.1 / at.0);
        let ball = |t: f64, center: f64, gap: f64| {
            ((t - center).powi(2) + (0.5 + gap).powi(2)).sqrt() - 0.5
        };
        let f = |t: f64| ball(t, at.0, gaps.0).min(ball(t, at.1, gaps.1));
        let found = trace(3.0, 9.5, f);
        prop_assert_eq!(found.outcome, Outcome::Miss);
        let ratios = [gaps.0 / at.0, gaps.1 / at.1];
        let (ratio, center) =
            if ratios[0] < ratios[1] { (ratios[0], at.0) } else { (ratios[1], at.1) };
        prop_assert!((found.clearance / ratio - 1.0).abs() < 0.15, "{:?} for {}", found, ratio);
        prop_assert!((found.nearest - center).abs() < 0.15, "{:?} for {}", found, center);
        let lowest = gaps.0.min(gaps.1);
        prop_assert!((found.f - lowest).abs() < 0.02 + 0.1 * lowest, "{:?}", found);
    }

    /// A wedge (two planes that meet in an edge) whose edge is `depth` inside of the ray.
    #[test]
    fn a_wedge_is_hit_exactly_if_its_edge_is_below_zero(
        edge in 4.0..8.0f64,
        depth in (-9.0..-2.0f64).prop_map(|exponent| f64::powf(10.0, exponent)),
        slopes in (0.1..1.0f64, 0.1..1.0f64),
        inside in any::<bool>(),
    ) {
        let height = if inside { -depth } else { depth };
        let f = |t: f64| (slopes.0 * (edge - t)).max(slopes.1 * (t - edge)) + height;
        let found = trace(3.0, 9.0, f);
        prop_assert_eq!(found.outcome == Outcome::Hit, inside, "{:?}", found);
        if inside {
            prop_assert!((found.t - edge + depth / slopes.0).abs() < 1e-12, "{:?}", found);
        } else {
            prop_assert!(found.f > 0.0 && found.clearance > 0.0, "{:?}", found);
        }
    }
}
