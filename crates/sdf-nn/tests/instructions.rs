//! The passes of a network with every instruction set, and with few points.

use field::Field;
use glam::Vec3;
use random::Stream;
use sdf_nn::{
    Activation, Architecture, Degree, Encoding, Instructions, Network, SplineSize, Transform,
};

/// The results of all passes over the same points.
fn all_passes(network: &Network<f32>, x: &[Vec3]) -> Vec<f32> {
    let (mut f, mut g, mut h) =
        (vec![0.0; x.len()], vec![Vec3::ZERO; x.len()], vec![Vec3::ZERO; x.len()]);
    let mut theta = vec![0.0; network.parameter_count()];
    network.value(x, &mut f);
    let alpha = f.clone();
    network.value_gradient(x, &mut f, &mut g);
    network.parameter_vjp(x, &alpha, &g, &mut theta);
    let flat = |v: &[Vec3]| v.iter().flat_map(|v| v.to_array()).collect::<Vec<_>>();
    let mut all = [alpha, f, flat(&g)].concat();
    network.hessian_vector(x, x, &mut g, &mut h);
    all.extend([flat(&g), flat(&h), theta].concat());
    all
}

/// A network with splines whose parameters are all unlike each other. Some nodes of the second
/// level are free.
fn wavy(encoding: Encoding, hidden: &[usize], skip: Vec<usize>) -> Network<f32> {
    let (features, degree) =
        if skip.is_empty() { (2, Degree::Quadratic) } else { (3, Degree::Cubic) };
    let grid = SplineSize { features, degree, levels: vec![6, 12] };
    let (hidden, activation) = (hidden.to_vec(), Activation::Softplus { beta: 100.0 });
    let architecture = Architecture { encoding, grid, hidden, skip, activation };
    let mut network =
        Network::geometric(architecture, Transform::default(), 0.5, Stream::of_seed(3));
    let is_free: Vec<bool> = (0..12 * 12 * 12).map(|i| i % 12 < 7 && i % 5 < 3).collect();
    network.set_free_nodes(1, &is_free);
    let waves = network.parameters().iter().enumerate();
    let parameters: Vec<f32> = waves.map(|(i, p)| p + 0.01 * (i as f32).sin()).collect();
    network.set_parameters(&parameters);
    network
}

fn points(count: usize) -> Vec<Vec3> {
    (0..count).map(|i| Vec3::new((i as f32).sin(), (i as f32).cos(), 0.3) * 0.6).collect()
}

/// Blocks, halves of blocks and few points: a point has the same bits in all of them.
#[test]
fn the_bits_of_a_point_do_not_depend_on_the_points_beside_it() {
    for skip in [vec![], vec![1]] {
        let (network, x) = (wavy(Encoding::Frequency { bands: 4 }, &[40; 2], skip), points(70));
        let (mut f, mut g) = (vec![0.0; 70], vec![Vec3::ZERO; 70]);
        network.value_gradient(&x, &mut f, &mut g);
        let (mut ignored, mut h) = (g.clone(), g.clone());
        network.hessian_vector(&x, &x, &mut ignored, &mut h);
        for count in 1..=70 {
            let (mut some_f, mut values) = (vec![0.0; count], vec![0.0; count]);
            let mut some_g = vec![Vec3::ZERO; count];
            network.value(&x[..count], &mut values);
            network.value_gradient(&x[..count], &mut some_f, &mut some_g);
            assert_eq!((&values[..], &some_f[..]), (&f[..count], &f[..count]), "{count}");
            assert_eq!(some_g, g[..count], "{count} points");
            let mut some_h = some_g.clone();
            network.hessian_vector(&x[..count], &x[..count], &mut some_g, &mut some_h);
            assert_eq!(some_h, h[..count], "{count} points");
        }
    }
}

/// All instruction sets add in the same order, so those with fused multiply–add give the same
/// bits.
#[test]
fn instruction_sets_agree() {
    let octaves = Encoding::Frequency { bands: 6 };
    // The last points are one half of a block, or that and a few: 4, 2 and 1.
    for (width, skip, encoding, count) in [
        (64, vec![], octaves, 75),
        (64, vec![], octaves, 87),
        (40, vec![1], octaves, 87),
        (37, vec![2], Encoding::None, 75),
        (8, vec![1], Encoding::None, 69),
    ] {
        let (network, x) = (wavy(encoding, &[width; 3], skip), points(count));
        let sets = Instructions::ALL.into_iter().filter(|set| set.are_available());
        let results: Vec<(Instructions, Vec<f32>)> = sets
            .map(|set| (set, all_passes(&network.clone().with_instructions(set), &x)))
            .collect();
        let (_, portable) = results.last().unwrap();
        for (set, result) in &results {
            for (a, b) in result.iter().zip(portable) {
                let scale = b.abs().max(1.0);
                assert!((a - b).abs() < 1e-3 * scale, "{set:?} gives {a}, portable ones {b}");
            }
        }
        if let [(Instructions::Avx512, wide), (Instructions::Avx2, narrow), _] = &results[..] {
            let bits = |result: &[f32]| result.iter().map(|a| a.to_bits()).collect::<Vec<_>>();
            assert!(bits(wide) == bits(narrow), "AVX-512 and AVX2 give different bits");
        }
    }
}
