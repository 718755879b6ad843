//! V is continuous along the film, also where points join and leave the largest k, and where they
//! come into being.

use warp::WarpOptions;

use crate::scene::{FIELDS, Scene, field};

/// V and the kept points at the film position `s` of a line, or `None` outside the bounds.
fn along(scene: &Scene, s: f64, tangent: &[f64]) -> Option<([f64; 2], usize, Vec<usize>)> {
    let record = scene.record([2.0 + 28.0 * s, 9.0 + 9.0 * s])?;
    let warp = scene.warp(&[record.ray()]);
    let x = warp.points();
    let (mut f_dot, mut g_dot) = (vec![0.0; x.len()], vec![glam::DVec3::ZERO; x.len()]);
    scene.field.parameter_jvp(&x, tangent, &mut f_dot, &mut g_dot);
    let kept = warp.samples.iter().map(|sample| sample.index).collect();
    Some((warp.velocity(&f_dot)[0], record.t.len(), kept))
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The largest jump of V on the line that bisection cannot shrink, in pixels per unit of the
/// parameter, and how often the kept points change and the number of points passes k.
fn largest_jump(scene: &Scene, intervals: usize) -> (f64, usize, usize) {
    let tangent: Vec<f64> =
        (0..scene.field.parameter_count()).map(|i| 0.3 + 0.1 * i as f64).collect();
    let (mut jump, mut changes, mut births) = (0.0f64, 0, 0);
    for i in 0..intervals {
        let ends = [i, i + 1].map(|i| i as f64 / intervals as f64);
        let [Some(a), Some(b)] = ends.map(|s| along(scene, s, &tangent)) else { continue };
        changes += usize::from(a.2 != b.2);
        births += usize::from((a.1 > scene.options.top_k) != (b.1 > scene.options.top_k));
        let (mut low, mut high, mut va, mut vb) = (ends[0], ends[1], a.0, b.0);
        while high - low > 1e-13 && distance(va, vb) > 1e-5 {
            let middle = 0.5 * (low + high);
            let Some((v, _, _)) = along(scene, middle, &tangent) else { break };
            // Into the half that changes more: a jump stays in it.
            if distance(va, v) > distance(v, vb) {
                (high, vb) = (middle, v)
            } else {
                (low, va) = (middle, v)
            }
        }
        jump = jump.max(distance(va, vb));
    }
    (jump, changes, births)
}

#[test]
fn the_warp_does_not_jump_where_the_kept_points_change() {
    let (mut changes, mut births) = (0, 0);
    for kind in 0..FIELDS {
        for (k, points) in [(3, 22), (7, 22), (14, 22), (22, 22), (23, 22), (8, 12)] {
            let options =
                WarpOptions { steps: points, top_k: k, epsilon: 1e-3, ..WarpOptions::PUBLISHED };
            let (jump, c, b) = largest_jump(&Scene::new(field(kind), options), 160);
            assert!(jump < 1e-4, "field {kind}, k = {k} of {points}: V jumps by {jump}");
            (changes, births) = (changes + c, births + b);
        }
    }
    println!(
        "continuous over {changes} changes of the kept points, {births} passings of k by the number of points"
    );
    assert!(changes > 500 && births > 20, "{changes} {births}");
}

/// With k = 2 the larger point has all the weight, so V jumps where the two largest swap: the
/// supplement's argument for continuity (lemma 4.1) needs a third point.
#[test]
fn two_points_are_too_few() {
    let options = WarpOptions { top_k: 2, epsilon: 1e-3, ..WarpOptions::PUBLISHED };
    let (jump, ..) = largest_jump(&Scene::new(field(0), options), 160);
    assert!(jump > 0.1, "{jump}");
}
