//! Hits against closed forms, grazing rays, fields that are not distances, NaN and infinities, and
//! derivatives against finite differences.

mod common;

use approx::assert_relative_eq;
use field::{Counted, Csg, Field, Kind, Shape, Sphere, Vector3};
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use trace::{
    HitAdjoint, Intersection, Options, Outcome, Ray, entry_derivative, hit_film_derivative,
    hit_vjp, intersect, visit,
};

use common::solids;

const BOUNDS: Sphere<f64> = Sphere { center: DVec3::ZERO, radius: 2.0 };

fn find(field: &dyn Field<f64>, origin: DVec3, direction: DVec3) -> Intersection<f64> {
    find_relaxed(field, origin, direction, 1.0)
}

fn find_relaxed(
    field: &dyn Field<f64>,
    origin: DVec3,
    direction: DVec3,
    relaxation: f64,
) -> Intersection<f64> {
    let ray = Ray::enter(origin, direction, &BOUNDS).expect("the ray meets the ball");
    let mut out = Vec::new();
    intersect(field, &[ray], &Options { relaxation, ..Options::default() }, &mut out);
    out[0]
}

fn value(field: &dyn Field<f64>, x: DVec3) -> f64 {
    let mut f = [0.0];
    field.value(&[x], &mut f);
    f[0]
}

/// A field times a factor: |∇f| is the factor.
struct Scaled(Box<dyn Field<f64>>, f64);

impl Field<f64> for Scaled {
    fn parameter_count(&self) -> usize {
        0
    }
    fn bounds(&self) -> Option<Sphere<f64>> {
        self.0.bounds()
    }
    fn value(&self, x: &[DVec3], f: &mut [f64]) {
        self.0.value(x, f);
        f.iter_mut().for_each(|f| *f *= self.1);
    }
    fn value_gradient(&self, x: &[DVec3], f: &mut [f64], g: &mut [DVec3]) {
        self.0.value_gradient(x, f, g);
        f.iter_mut().for_each(|f| *f *= self.1);
        g.iter_mut().for_each(|g| *g *= self.1);
    }
    fn hessian_vector(&self, x: &[DVec3], p: &[DVec3], g: &mut [DVec3], h: &mut [DVec3]) {
        self.0.hessian_vector(x, p, g, h);
    }
    fn parameter_vjp(&self, _: &[DVec3], _: &[f64], _: &[DVec3], _: &mut [f64]) {}
}

fn unit() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.0..1.0f64)
        .prop_map(DVec3::from)
        .prop_filter("a direction", |v| v.length() > 0.1)
        .prop_map(DVec3::normalize)
}

/// The angle of a ray to an edge of a box, and the place along the edge that the ray passes.
fn edge() -> impl Strategy<Value = (f64, f64)> {
    (0.2..1.3f64, -0.8..0.8f64)
}

/// A ray that passes the edge (0.7, 0.5, along) of a box in the plane z = along, at a distance of
/// 10^offset.
fn past_an_edge(
    (yaw, along): (f64, f64),
    offset: f64,
    inside: bool,
    factor: f64,
    relaxation: f64,
) -> Intersection<f64> {
    let field =
        Scaled(Box::new(Shape::<f64>::new(Kind::Box, &[0.1, 0.0, 0.0, 0.6, 0.5, 0.9])), factor);
    let side = DVec3::new(yaw.cos(), yaw.sin(), 0.0);
    let past = f64::powf(10.0, offset) * if inside { -1.0 } else { 1.0 };
    let direction = DVec3::new(-yaw.sin(), yaw.cos(), 0.0);
    let on_ray = DVec3::new(0.7, 0.5, along) + past * side;
    find_relaxed(&field, on_ray - 4.0 * direction, direction, relaxation)
}

/// The parameters of a torus, a capsule and the width of their smooth union.
const UNION: [f64; 16] =
    [0.0, 0.1, 0.0, 0.3, 1.0, 0.2, 0.8, 0.25, -0.8, 0.0, 0.2, 0.7, 0.4, -0.3, 0.2, 0.4];

fn union(p: &[f64; 16]) -> Csg<f64> {
    let torus = Box::new(Shape::<f64>::new(Kind::Torus, &p[..8]));
    let capsule = Box::new(Shape::<f64>::new(Kind::Capsule, &p[8..15]));
    Csg::smooth_union(p[15], vec![torus, capsule])
}

proptest! {
    #[test]
    fn hits_are_first_crossings(
        from in unit(),
        aim in prop::array::uniform3(-0.8..0.8f64),
        factor in prop::sample::select(vec![0.3, 1.0, 1.8]),
    ) {
        for (_, solid) in solids() {
            let field = Scaled(solid, factor);
            let (origin, target) = (from * 4.0, DVec3::from(aim));
            let direction = (target - origin).normalize();
            let found = find_relaxed(&field, origin, direction, f64::min(1.0, 1.0 / factor));
            let sample = |t: f64| value(&field, origin + t * direction);
            let mut samples = (0..8000).map(|i| 2.0 + 4.0 * f64::from(i) / 8000.0);
            let first = samples.find(|t| sample(*t) < -1e-3);
            match found.outcome {
                Outcome::Hit => {
                    prop_assert!(sample(found.t).abs() < 1e-9);
                    // No solid part lies before the hit.
                    let is_first = first.is_none_or(|t| found.t <= t + 1e-9);
                    prop_assert!(is_first, "hit at {} behind {first:?}", found.t);
                }
                Outcome::Miss => prop_assert!(first.is_none(), "missed the solid at {first:?}"),
                other => prop_assert!(false, "{other:?}"),
            }
        }
    }

    #[test]
    fn rays_past_an_edge_of_a_box_are_decided_correctly(
        edge in edge(),
        offset in -7.0..-1.5f64,
        inside in any::<bool>(),
        factor in prop::sample::select(vec![0.5, 1.0, 3.0]),
    ) {
        let found = past_an_edge(edge, offset, inside, factor, f64::min(1.0, 1.0 / factor));
        prop_assert_eq!(found.outcome == Outcome::Hit, inside, "{:?}", found);
        prop_assert!(found.steps < 120, "{} steps", found.steps);
    }

    #[test]
    fn rays_past_an_edge_of_a_steep_field_are_decided_correctly_without_relaxation(
        edge in edge(),
        offset in -4.0..-1.5f64,
        inside in any::<bool>(),
    ) {
        // No value before the edge shows the slope behind it: a chord shorter than a fiftieth of
        // `min_step` may be missed, so the offsets start at 1e-4.
        let found = past_an_edge(edge, offset, inside, 3.0, 1.0);
        prop_assert_eq!(found.outcome == Outcome::Hit, inside, "{:?}", found);
        prop_assert!(found.steps < 120, "{} steps", found.steps);
    }

    #[test]
    fn steep_fields_are_hit_without_relaxation(
        from in unit(),
        aim in prop::array::uniform3(-0.5..0.5f64),
        factor in prop::sample::select(vec![1.5, 2.0, 5.0]),
    ) {
        // Only the values of f show that it is not a distance.
        let center = DVec3::new(0.1, 0.0, -0.2);
        let ball = Scaled(Box::new(Shape::<f64>::sphere(center.to_array(), 0.7)), factor);
        let (origin, aim) = (from * 4.0, DVec3::from(aim));
        let direction = (aim - origin).normalize();
        let b = (center - origin).reject_from_normalized(direction).length();
        let found = find(&ball, origin, direction);
        let hit = found.outcome == Outcome::Hit;
        prop_assert_eq!(hit, b < 0.7, "{} from the centre: {:?}", b, found);
    }

    #[test]
    fn grazing_rays_are_decided_by_their_closest_approach(
        offset in -7.0..-1.0f64,
        inside in any::<bool>(),
        angle in 0.0..std::f64::consts::TAU,
    ) {
        let ball = Shape::<f64>::sphere([0.0; 3], 0.7);
        let distance = 0.7 + if inside { -1.0 } else { 1.0 } * f64::powf(10.0, offset);
        let (s, c) = angle.sin_cos();
        let found = find(&ball, DVec3::new(distance * c, distance * s, 4.0), -DVec3::Z);
        prop_assert_eq!(found.outcome == Outcome::Hit, inside, "{} steps", found.steps);
        prop_assert!(found.steps < 120, "{} steps", found.steps);
        if !inside {
            let gap = distance - 0.7;
            let close = (found.f - gap).abs() < 1e-4 + 0.02 * gap;
            prop_assert!(close, "closest approach {} for {gap}", found.f);
        }
    }

    #[test]
    fn a_ray_takes_at_most_200_evaluations_more_than_the_step_limit(
        from in unit(),
        aim in prop::array::uniform3(-0.8..0.8f64),
        step_limit in 1u32..40,
    ) {
        for (_, solid) in solids() {
            let origin = from * 4.0;
            let direction = (DVec3::from(aim) - origin).normalize();
            let ray = Ray::enter(origin, direction, &BOUNDS).unwrap();
            let (options, mut out) = (Options { step_limit, ..Options::default() }, Vec::new());
            intersect(&*solid, &[ray], &options, &mut out);
            let most = step_limit + if out[0].outcome == Outcome::Hit { 200 } else { 0 };
            prop_assert!(out[0].steps <= most, "{:?} at a limit of {step_limit}", out[0]);
        }
    }

    #[test]
    fn clearance_is_the_angle_of_a_near_miss(gap in 0.0005..0.3f64) {
        let ball = Shape::<f64>::sphere([0.0; 3], 0.7);
        let found = find(&ball, DVec3::new(0.7 + gap, 0.0, 4.0), -DVec3::Z);
        prop_assert_eq!(found.outcome, Outcome::Miss);
        let clearance = found.clearance;
        let close = (clearance * 4.0 / gap - 1.0).abs() < 0.2;
        prop_assert!(close, "clearance {clearance} for a gap of {gap}");
    }

    #[test]
    fn film_and_entry_derivatives_match_finite_differences(
        aim in prop::array::uniform3(-0.5..0.5f64),
        dot in unit(),
    ) {
        for (_, solid) in solids() {
            let origin = DVec3::new(0.3, 0.5, 4.0);
            let direction = (DVec3::from(aim) - origin).normalize();
            let dot = dot.reject_from_normalized(direction);
            let moved = |h: f64| {
                let d = (direction + h * dot).normalize();
                let ray = Ray::enter(origin, d, &BOUNDS).unwrap();
                (ray, find(&*solid, origin, d))
            };
            let (ray, here) = moved(0.0);
            let h = 1e-5;
            let ((plus, p), (minus, m)) = (moved(h), moved(-h));
            let entry = entry_derivative(&ray, &BOUNDS, dot);
            assert_relative_eq!(entry, (plus.near - minus.near) / (2.0 * h), epsilon = 1e-6);
            if [here, p, m].iter().all(|found| found.outcome == Outcome::Hit) {
                let (mut f, mut g) = ([0.0], [DVec3::ZERO]);
                solid.value_gradient(&[ray.at(here.t)], &mut f, &mut g);
                let difference = (plus.at(p.t) - minus.at(m.t)) / (2.0 * h);
                let second = (plus.at(p.t) + minus.at(m.t) - 2.0 * ray.at(here.t)).length() / h;
                if g[0].dot(direction) < -0.2 && second < 1e-2 {
                    let dx = hit_film_derivative(g[0], direction, here.t, dot);
                    let close = (dx - difference).length() < 1e-3 * (1.0 + difference.length());
                    prop_assert!(close, "{dx} against {difference}");
                }
            }
        }
    }

    #[test]
    fn hit_vjp_matches_finite_differences_of_traced_hits(
        aim in prop::array::uniform2(-0.35..0.35f64),
        x_bar in unit(),
        n_bar in unit(),
        j in 0usize..16,
    ) {
        let origin = DVec3::new(0.3, 3.5, 1.0);
        let direction = (DVec3::new(aim[0], 0.0, aim[1]) - origin).normalize();
        let total = |p: &[f64; 16]| {
            let field = union(p);
            let found = find(&field, origin, direction);
            let x = origin + found.t * direction;
            let (mut f, mut g) = ([0.0], [DVec3::ZERO]);
            field.value_gradient(&[x], &mut f, &mut g);
            (found.outcome, x, g[0], x.dot(x_bar) + g[0].normalize().dot(n_bar))
        };
        let (outcome, x, g, _) = total(&UNION);
        let moved = |h: f64| {
            let mut p = UNION;
            p[j] += h;
            total(&p).3
        };
        prop_assume!(outcome == Outcome::Hit && g.normalize().dot(direction) < -0.3);
        let coarse = (moved(1e-4) - moved(-1e-4)) / 2e-4;
        let fine = (moved(5e-5) - moved(-5e-5)) / 1e-4;
        prop_assume!((coarse - fine).abs() < 1e-4);
        let field = union(&UNION);
        let m = HitAdjoint::<f64>::normal_coefficient(g, n_bar);
        let (mut ignored, mut hm) = ([DVec3::ZERO], [DVec3::ZERO]);
        field.hessian_vector(&[x], &[m], &mut ignored, &mut hm);
        let adjoint = hit_vjp::<f64>(g, direction, x_bar + hm[0], m);
        let mut theta = vec![0.0; 16];
        field.parameter_vjp(&[x], &[adjoint.alpha], &[adjoint.c], &mut theta);
        let close = (theta[j] - fine).abs() < 2e-3 * (1.0 + fine.abs());
        prop_assert!(close, "parameter {j}: {} against {fine}", theta[j]);
    }

    #[test]
    fn a_ray_from_a_huge_or_invalid_origin_ends(
        poison in prop::sample::select(vec![
            f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e30, -1e30, 1e-310,
        ]),
        i in 0usize..3,
    ) {
        let ball = Shape::<f64>::sphere([0.0; 3], 0.7);
        let mut origin = DVec3::new(0.1, 0.2, 4.0);
        origin[i] = poison;
        if let Some(ray) = Ray::enter(origin, -DVec3::Z, &BOUNDS) {
            let mut out = Vec::new();
            intersect(&ball, &[ray], &Options::default(), &mut out);
            prop_assert!(out[0].steps <= 512);
        }
    }
}

#[test]
fn factors_of_nan_zero_and_1e_9_give_invalid_inside_and_hit() {
    let ball = Shape::<f64>::sphere([0.0; 3], 0.7);
    for (factor, outcome) in
        [(f64::NAN, Outcome::Invalid), (0.0, Outcome::Inside), (1e-9, Outcome::Hit)]
    {
        let found =
            find(&Scaled(Box::new(ball.clone()), factor), DVec3::new(0.1, 0.2, 4.0), -DVec3::Z);
        assert_eq!(found.outcome, outcome, "factor {factor}");
    }
}

#[test]
fn a_ray_parallel_to_a_plane_misses() {
    let plane = Shape::<f64>::new(Kind::Plane, &[0.0, 1.0, 0.0, -1.0]);
    let along = find(&plane, DVec3::new(0.0, 0.0, 4.0), -DVec3::Z);
    assert_eq!(along.outcome, Outcome::Miss);
    assert_relative_eq!(along.f, 1.0);
}

#[test]
fn single_and_double_precision_decide_alike_near_a_silhouette() {
    let (single, double) =
        (Shape::<f32>::sphere([0.0; 3], 0.7), Shape::<f64>::sphere([0.0; 3], 0.7));
    let bounds = Sphere::<f32> { center: Vec3::ZERO, radius: 2.0 };
    let mut wrong = 0;
    for i in 0..1000 {
        let x = 0.69 + 0.02 * f64::from(i) / 1000.0;
        let origin = DVec3::new(x, 0.01, 4.0);
        let ray = Ray::enter(Vec3::of(origin), -Vec3::Z, &bounds).unwrap();
        let mut out = Vec::new();
        intersect(&single, &[ray], &Options::default(), &mut out);
        wrong += usize::from(out[0].outcome != find(&double, origin, -DVec3::Z).outcome);
    }
    assert!(wrong <= 1, "{wrong} of 1000 decisions differ within 0.01 of the silhouette");
}

#[test]
fn rays_end_where_min_step_is_below_the_spacing_of_numbers() {
    // At this distance single-precision numbers are 1/64 apart.
    let (eye, bounds) =
        (Vec3::new(0.0, 0.0, 1.5e5), Sphere::<f32> { center: Vec3::ZERO, radius: 1.02 });
    let ball = Shape::<f32>::sphere([0.0; 3], 1.0);
    let rays: Vec<Ray<f32>> = (0..200)
        .filter_map(|i| {
            Ray::enter(eye, Vec3::new(1e-7 * i as f32 - 1e-5, 0.0, -1.0).normalize(), &bounds)
        })
        .collect();
    let mut out = Vec::new();
    intersect(&ball, &rays, &Options::default(), &mut out);
    let hits = out.iter().filter(|found| found.outcome == Outcome::Hit).count();
    assert!(hits > 100 && out.iter().all(|found| found.steps < 1000), "{hits} hits");
}

#[test]
fn a_view_costs_fewer_than_16_evaluations_per_ray() {
    for (_, solid) in solids() {
        let field = Counted::new(solid);
        let mut rays = Vec::new();
        for i in 0..64 * 64 {
            let origin = DVec3::new(0.4, 0.3, 5.0);
            let target =
                DVec3::new(f64::from(i % 64) / 32.0 - 1.0, f64::from(i / 64) / 32.0 - 1.0, 0.0)
                    * 1.3;
            rays.extend(Ray::enter(origin, (target - origin).normalize(), &BOUNDS));
        }
        let mut out = Vec::new();
        intersect(&field, &rays, &Options::default(), &mut out);
        let mean = field.evaluations().value as f64 / rays.len() as f64;
        println!("{mean:.2} values per ray");
        assert!(mean < 16.0, "{mean} values per ray");
    }
}

#[test]
fn visits_follow_the_recursion_and_end_at_the_interval_end() {
    let ball = Shape::<f64>::sphere([0.0; 3], 0.7);
    let rays: Vec<_> = [0.0, 0.69, 0.71, 1.5]
        .map(|x| Ray::enter(DVec3::new(x, 0.0, 4.0), -DVec3::Z, &BOUNDS).unwrap())
        .to_vec();
    let visits = visit(&ball, &rays, 22, 1.0);
    for (i, ray) in rays.iter().enumerate() {
        let v = visits.ray(i);
        assert_eq!(v.t[0], ray.near);
        for p in 0..v.t.len() {
            assert_relative_eq!(v.f[p], value(&ball, ray.at(v.t[p])), epsilon = 1e-14);
            if p + 1 < v.t.len() {
                assert_relative_eq!(v.t[p + 1], v.t[p] + v.f[p], epsilon = 1e-14);
                assert_eq!(v.step[p], v.f[p]);
            }
        }
        if v.clamped {
            assert_relative_eq!(
                v.t[v.t.len() - 1] + v.step[v.t.len() - 1],
                ray.far,
                epsilon = 1e-12
            );
        }
    }
    assert!(visits.ray(3).clamped && visits.ray(3).t.len() < 22);
    assert_eq!(visits.ray(1).t.len(), 22);
}
