//! The lemmas of Bangaru et al. 2022, supplement, section 3, over random smooth fields and rays.

use field::{Csg, Field, Kind, Shape, Sphere};
use glam::DVec3;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use trace::{RayFamily, Start, Tangency, tangencies};
use warp::{Warp, WarpOptions, WarpedRay, evaluate};

use crate::scene::{Pinhole, Scene};

/// The rays along a row of the film.
struct Row<'a>(&'a Pinhole, f64);

impl RayFamily<f64> for Row<'_> {
    fn origin(&self, _: usize) -> DVec3 {
        self.0.eye
    }
    fn direction(&self, _: usize, s: f64) -> (DVec3, DVec3) {
        (self.0.direction([s, self.1]), self.0.direction_du([s, self.1])[0])
    }
}

/// The numbers of a smooth union of a ball, a torus and a capsule.
fn blob() -> impl Strategy<Value = ([f64; 3], [f64; 3], [f64; 3], f64, f64)> {
    let place = || prop::array::uniform3(-0.3..0.3f64);
    (place(), place(), place(), 0.2..0.4f64, 0.15..0.3f64)
}

fn build((a, b, c, radius, k): ([f64; 3], [f64; 3], [f64; 3], f64, f64)) -> Box<dyn Field<f64>> {
    let children: Vec<Box<dyn Field<f64>>> = vec![
        Box::new(Shape::sphere(a, radius)),
        Box::new(Shape::new(Kind::Torus, &[b[0], b[1], b[2], 0.3, 0.8, 0.5, 0.45, 0.18])),
        Box::new(Shape::new(Kind::Capsule, &[c[0], c[1], c[2], 0.4, -0.3, 0.2, 0.15])),
    ];
    Box::new(Csg::smooth_union(k, children))
}

fn scene(field: Box<dyn Field<f64>>, points: usize, gamma: f64) -> Scene {
    let camera = Pinhole::looking_at_origin(DVec3::new(0.6, 0.8, 3.6));
    let options = WarpOptions { steps: points, top_k: points + 1, gamma, ..WarpOptions::IMAGE };
    let bounds = Sphere { center: DVec3::ZERO, radius: 1.6 };
    Scene { field, camera, bounds, options, relaxation: 1.0 }
}

/// The rightmost silhouette on a row of the film: no part of the solid hides it.
fn outline(scene: &Scene, row: f64) -> Option<Tangency<f64>> {
    // From the right border: the first ray that comes close to the solid.
    let lowest =
        |s: f64| scene.record([s, row]).map(|r| (r.f.iter().copied().fold(f64::MAX, f64::min), r));
    let mut s = 31.0;
    while s > 1.0 {
        let (low, record) = lowest(s)?;
        if low < 0.02 {
            let at = record.f.iter().position(|f| *f == low)?;
            let start =
                Start { s, t: record.t[at], range: [s - 4.0, s + 4.0], reach: 0.02, steepest: 1.0 };
            return tangencies(scene.field.as_ref(), &Row(&scene.camera, row), &[start], 1e-9)[0];
        }
        s -= 0.25;
    }
    None
}

fn warp_at(scene: &Scene, u: [f64; 2]) -> Option<Warp<f64>> {
    let record = scene.record(u)?;
    Some(scene.warp(&[record.ray()]))
}

/// The derivative of f at points, along a tangent without zeros.
fn along(field: &dyn Field<f64>, x: &[DVec3]) -> Vec<f64> {
    let tangent: Vec<f64> =
        (0..field.parameter_count()).map(|i| if i % 3 == 0 { 1.0 } else { -0.4 }).collect();
    let (mut f, mut g) = (vec![0.0; x.len()], vec![DVec3::ZERO; x.len()]);
    field.parameter_jvp(x, &tangent, &mut f, &mut g);
    f
}

/// |V·n − v| relative to the scale of the normal velocity v of a silhouette, and the sum of the
/// weights farther than 0.1 from the silhouette point.
fn at_the_outline(scene: &Scene, row: f64, found: &Tangency<f64>) -> Option<(f64, f64)> {
    let direction = scene.camera.direction([found.s, row]);
    let x = scene.camera.eye + direction * found.t;
    let rise = scene.camera.direction_du([found.s, row]).map(|du| found.gradient.dot(du) * found.t);
    let square = rise[0] * rise[0] + rise[1] * rise[1];
    let warp = warp_at(scene, [found.s + 1e-6 * rise[0].signum(), row])?;
    let v = warp.velocity(&along(scene.field.as_ref(), &warp.points()))[0];
    let expected = -along(scene.field.as_ref(), &[x])[0] / square.sqrt();
    let normal = (v[0] * rise[0] + v[1] * rise[1]) / square.sqrt();
    let far: f64 = warp.samples.iter().filter(|s| s.x.distance(x) > 0.1).map(|s| s.weight).sum();
    Some(((normal - expected).abs() / (expected.abs() + 1.0 / square.sqrt()), far))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Lemmas 3.1 to 3.4: V tends to the velocity of the silhouette as u tends to the silhouette and N
/// grows, and all the weight concentrates at the silhouette point.
#[test]
fn the_warp_is_boundary_consistent_for_random_fields() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let counts = [22usize, 64, 200, 600];
    let (mut errors, mut far) = (vec![Vec::new(); counts.len()], vec![Vec::new(); counts.len()]);
    for _ in 0..60 {
        let tree = (blob(), 12.0..20.0f64).new_tree(&mut runner).expect("a field");
        let (numbers, row) = tree.current();
        let mut scene = scene(build(numbers), 22, 3.0);
        let Some(found) = outline(&scene, row) else { continue };
        let results: Option<Vec<(f64, f64)>> = counts
            .iter()
            .map(|&n| {
                (scene.options.steps, scene.options.top_k) = (n, n + 1);
                at_the_outline(&scene, row, &found)
            })
            .collect();
        for (i, (error, weight)) in results.into_iter().flatten().enumerate() {
            errors[i].push(error);
            far[i].push(weight);
        }
    }
    assert!(errors[0].len() > 30, "{} silhouettes", errors[0].len());
    let (errors, far): (Vec<f64>, Vec<f64>) =
        (errors.into_iter().map(median).collect(), far.into_iter().map(median).collect());
    for i in 0..counts.len() {
        println!(
            "N = {:4}: median error of V·n {:.4}, median weight beyond 0.1 {:.5}",
            counts[i], errors[i], far[i]
        );
    }
    let growth = (counts[3] as f64 / counts[0] as f64).ln();
    let rate = (errors[0] / errors[3]).ln() / growth;
    println!(
        "rate: error ~ N^-{rate:.2}, weight ~ N^-{:.2}",
        (far[0] / far[3].max(1e-12)).ln() / growth
    );
    assert!(rate > 0.6 && errors[3] < 0.05, "{errors:?}");
    assert!(far[3] < 0.02 && far[3] < 0.1 * far[0], "{far:?}");
}

/// ∫∇·V over a square of the film and ∮V·n over its border, and the scale of both.
fn balance(scene: &Scene, corner: [f64; 2], side: f64) -> Option<[f64; 3]> {
    let n = 24;
    let at = |i: usize| (i as f64 + 0.5) / n as f64 * side;
    let (mut area, mut border, mut scale) = (0.0, 0.0, 0.0);
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let record = scene.record([corner[0] + at(i), corner[1] + at(j)])?;
        // Only squares without a silhouette: all points keep clear of the solid.
        if record.f.iter().any(|f| *f < 0.05) {
            return None;
        }
        let out = scene.warp_with_divergence(&[record.ray()]);
        let x = out.warp.points();
        let tangent: Vec<f64> =
            (0..scene.field.parameter_count()).map(|i| 0.3 + 0.1 * i as f64).collect();
        let (mut f, mut g) = (vec![0.0; x.len()], vec![DVec3::ZERO; x.len()]);
        scene.field.parameter_jvp(&x, &tangent, &mut f, &mut g);
        let divergence = out.divergence(&f, &g)[0];
        area += divergence * (side / n as f64).powi(2);
        scale += divergence.abs() * (side / n as f64).powi(2);
    }
    let m = 400;
    for i in 0..m {
        let along_edge = (f64::from(i) + 0.5) / f64::from(m) * side;
        let edges = [
            ([corner[0], corner[1] + along_edge], 0, -1.0),
            ([corner[0] + side, corner[1] + along_edge], 0, 1.0),
            ([corner[0] + along_edge, corner[1]], 1, -1.0),
            ([corner[0] + along_edge, corner[1] + side], 1, 1.0),
        ];
        for (u, axis, sign) in edges {
            let warp = warp_at(scene, u)?;
            let x = warp.points();
            let tangent: Vec<f64> =
                (0..scene.field.parameter_count()).map(|i| 0.3 + 0.1 * i as f64).collect();
            let (mut f, mut g) = (vec![0.0; x.len()], vec![DVec3::ZERO; x.len()]);
            scene.field.parameter_jvp(&x, &tangent, &mut f, &mut g);
            border += sign * warp.velocity(&f)[0][axis] * side / f64::from(m);
        }
    }
    Some([area, border, scale])
}

#[test]
fn the_divergence_over_a_pixel_is_the_flux_through_its_border() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let mut seen = 0;
    for _ in 0..40 {
        let tree = (blob(), 3.0..28.0f64, 3.0..28.0f64, prop::sample::select(vec![5usize, 14, 23]))
            .new_tree(&mut runner);
        let (numbers, x, y, k) = tree.expect("a field").current();
        let mut scene = scene(build(numbers), 22, 3.0);
        scene.options.top_k = k;
        let Some([area, border, scale]) = balance(&scene, [x, y], 1.0) else { continue };
        seen += 1;
        assert!(
            (area - border).abs() < 0.01 * scale + 1e-3,
            "at {x} {y}, k = {k}: {area} against {border}, of {scale}"
        );
    }
    assert!(seen >= 10, "{seen} pixels");
}

proptest! {
    /// Lemma 3.3, for γ on both sides of 2. Along a ray that touches a ball, the weight of a point
    /// at the distance δ from the tangent point scales as δ^(2 − γ). It grows without bound for γ >
    /// 2, and tends to 0 for γ < 2.
    #[test]
    fn weights_at_a_tangent_grow_above_an_exponent_of_two(
        gamma in 1.0..5.0f64,
        radius in 0.2..1.5f64,
        near in -4.0..-2.5f64,
    ) {
        let ball = Shape::<f64>::sphere([0.0; 3], radius);
        let (eye, d) = (DVec3::new(radius, 0.0, 5.0), -DVec3::Z);
        let delta = [f64::powf(10.0, near + 0.5), f64::powf(10.0, near)];
        let t = delta.map(|delta| 5.0 - delta);
        let x = t.map(|t| eye + t * d);
        let (mut f, mut g) = ([0.0; 2], [DVec3::ZERO; 2]);
        ball.value_gradient(&x, &mut f, &mut g);
        let camera = warp::Pinhole::looking_at(eye, eye + d, DVec3::Y, 64.0);
        let ray = WarpedRay {
            origin: eye,
            direction: d,
            direction_du: [DVec3::X, -DVec3::Y],
            entry_du: [0.0; 2],
            exit_du: [0.0; 2],
            relaxation: 1.0,
            t: &t,
            f: &f,
            gradient: &g,
            step: &f,
            clamped: false,
            valid: true,
        };
        let options = WarpOptions { gamma, epsilon: 0.0, ..WarpOptions::IMAGE };
        let warp = evaluate(&options.weighting::<f64>(1.0), 9, &[&camera], &[ray]);
        let [further, nearer] = [0, 1].map(|i| warp.samples[i].weight);
        let slope = (nearer / further).ln() / (delta[1] / delta[0]).ln();
        prop_assert!((slope - (2.0 - gamma)).abs() < 0.02 * gamma, "δ^{slope} for γ = {gamma}");
        if (gamma - 2.0).abs() > 0.02 * gamma {
            prop_assert_eq!(nearer > further, gamma > 2.0);
        }
    }
}
