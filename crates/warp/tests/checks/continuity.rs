//! V is continuous in u, also where points enter and leave the selection of the k largest weights,
//! and where a ray gains or loses a point.

use warp::WarpOptions;

use crate::scene::{FIELDS, Scene, field};

/// V, the number of points and the indices of those that keep a weight, at the parameter `s` of a
/// line on the film; `None` outside the bounds.
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
/// parameter; the number of changes of the points that keep a weight; and the number of times that
/// the number of points passes k.
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
            // Keep the half with the larger change: a jump stays in it.
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
fn the_warp_does_not_jump_where_the_selection_of_points_changes() {
    let (mut changes, mut births) = (0, 0);
    for kind in 0..FIELDS {
        for (k, points) in [(3, 22), (7, 22), (14, 22), (22, 22), (23, 22), (8, 12)] {
            let options =
                WarpOptions { steps: points, top_k: k, epsilon: 1e-3, ..WarpOptions::IMAGE };
            let (jump, c, b) = largest_jump(&Scene::new(field(kind), options), 160);
            assert!(jump < 1e-4, "field {kind}, k = {k} of {points}: V jumps by {jump}");
            (changes, births) = (changes + c, births + b);
        }
    }
    println!(
        "continuous over {changes} changes of the points that keep a weight; \
         the number of points passes k {births} times"
    );
    assert!(changes > 500 && births > 20, "{changes} {births}");
}

/// With k = 2 the point of largest weight has all the weight, so V jumps where the two largest
/// swap. The argument for continuity in Bangaru et al. 2022 (supplement, lemma 4.1) needs a third
/// point.
#[test]
fn the_warp_of_two_points_jumps() {
    let options = WarpOptions { top_k: 2, epsilon: 1e-3, ..WarpOptions::IMAGE };
    let (jump, ..) = largest_jump(&Scene::new(field(0), options), 160);
    assert!(jump > 0.1, "{jump}");
}
