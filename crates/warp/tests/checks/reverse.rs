//! Reverse mode is the transpose of forward mode.

use field::Field;
use glam::DVec3;
use proptest::prelude::*;
use warp::WarpOptions;

use crate::scene::{FIELDS, Record, Scene, field};

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// ⟨adjoints, forward(tangent)⟩ and ⟨reverse(adjoints), tangent⟩ for area and for boundary samples.
fn both_ways(
    scene: &Scene,
    records: &[Record],
    scalar: &[f64],
    film: &[[f64; 2]],
    tangent: &[f64],
) -> [[f64; 2]; 2] {
    let rays: Vec<_> = records.iter().map(Record::ray).collect();
    let field = scene.field.as_ref();
    let out = scene.warp_with_divergence(&rays);
    let x = out.warp.points();
    let n = x.len();
    let (mut f_dot, mut g_dot) = (vec![0.0; n], vec![DVec3::ZERO; n]);
    field.parameter_jvp(&x, tangent, &mut f_dot, &mut g_dot);
    let (v, divergence) = (out.warp.velocity(&f_dot), out.divergence(&f_dot, &g_dot));

    let forward: f64 = (0..rays.len())
        .map(|r| scalar[r] * divergence[r] + film[r][0] * v[r][0] + film[r][1] * v[r][1])
        .sum();
    let (alpha, c) = out.area_vjp(scalar, film);
    let reverse = dot(&parameter_gradient(field, &x, &alpha, &c), tangent);

    // A boundary sample enters the pixel with −(L − c) V·n.
    let axis: Vec<usize> = (0..rays.len()).map(|r| r % 2).collect();
    let flux_forward: f64 = (0..rays.len()).map(|r| -scalar[r] * v[r][axis[r]]).sum();
    let alpha = out.warp.flux_vjp(scalar, &axis);
    let flux_reverse = dot(&parameter_gradient(field, &x, &alpha, &vec![DVec3::ZERO; n]), tangent);
    [[forward, reverse], [flux_forward, flux_reverse]]
}

fn parameter_gradient(field: &dyn Field<f64>, x: &[DVec3], alpha: &[f64], c: &[DVec3]) -> Vec<f64> {
    let mut sum = vec![0.0; field.parameter_count()];
    field.parameter_vjp(x, alpha, c, &mut sum);
    sum
}

proptest! {
    #[test]
    fn reverse_mode_is_the_transpose_of_forward_mode(
        kind in 0..FIELDS,
        k in 2usize..26,
        gamma in 1.0..8.0f64,
        u in prop::collection::vec(prop::array::uniform2(2.0..30.0f64), 6),
        adjoint in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 6),
        tangent in prop::collection::vec(-1.0..1.0f64, 16),
    ) {
        let options = WarpOptions { top_k: k, gamma, epsilon: 1e-3, ..WarpOptions::IMAGE };
        let scene = Scene::new(field(kind), options);
        let records: Vec<_> = u.iter().filter_map(|&u| scene.record(u)).collect();
        let (scalar, film): (Vec<f64>, Vec<_>) =
            adjoint.iter().map(|a| (a[0], [a[1], a[2]])).unzip();
        let tangent = &tangent[..scene.field.parameter_count()];
        for [forward, reverse] in both_ways(&scene, &records, &scalar, &film, tangent) {
            prop_assert!(
                (forward - reverse).abs() < 1e-9 * (1.0 + forward.abs()),
                "{forward} {reverse}"
            );
        }
    }
}
