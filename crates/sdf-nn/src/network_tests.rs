//! The passes of a network with every instruction set, and with few points.

use std::cell::RefCell;

use glam::Vec3;

use super::*;
use crate::architecture::{Activation, Encoding};
use lanes::dispatch_all;

/// All passes over the same points; their results in one vector.
struct AllPasses<'a> {
    network: &'a Network<f32>,
    x: &'a [Vec3],
    results: &'a RefCell<Vec<Vec<f32>>>,
}

impl Pass for AllPasses<'_> {
    #[inline(always)]
    fn run<I: Isa>(self) {
        let AllPasses { network, x, results } = self;
        let (mut f, mut g, mut h) =
            (vec![0.0; x.len()], vec![Vec3::ZERO; x.len()], vec![Vec3::ZERO; x.len()]);
        let mut theta = vec![0.0; network.parameter_count()];
        Value { network, x, f: &mut f }.run::<I>();
        let alpha = f.clone();
        ValueGradient { network, x, f: &mut f, gradient: &mut g }.run::<I>();
        let (weights, table) = theta.split_at_mut(network.weight_count());
        ParameterVjp { network, x, alpha: &alpha, c: &g, weights, table }.run::<I>();
        let flat = |v: &[Vec3]| v.iter().flat_map(|v| v.to_array()).collect::<Vec<_>>();
        let mut all = [alpha, f, flat(&g)].concat();
        HessianVector { network, x, p: x, gradient: &mut g, product: &mut h }.run::<I>();
        all.extend([flat(&g), flat(&h), theta].concat());
        results.borrow_mut().push(all);
    }
}

/// A network with splines whose parameters are all unlike each other.
fn wavy(encoding: Encoding, hidden: &[usize], skip: Vec<usize>) -> Network<f32> {
    let grid = grids::SplineSize { features: 2, degree: grids::Degree::Quadratic, levels: vec![6] };
    let (hidden, activation) = (hidden.to_vec(), Activation::Softplus { beta: 100.0 });
    let architecture = Architecture { encoding, grid, hidden, skip, activation };
    let mut network = Network::geometric(architecture, Transform::default(), 0.5, 3);
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
        for count in 1..=70 {
            let (mut some_f, mut values) = (vec![0.0; count], vec![0.0; count]);
            let mut some_g = vec![Vec3::ZERO; count];
            network.value(&x[..count], &mut values);
            network.value_gradient(&x[..count], &mut some_f, &mut some_g);
            assert_eq!((&values[..], &some_f[..]), (&f[..count], &f[..count]), "{count}");
            assert_eq!(some_g, g[..count], "{count} points");
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
        let results = RefCell::new(Vec::new());
        let mut names = Vec::new();
        dispatch_all(|name| {
            names.push(name);
            AllPasses { network: &network, x: &x, results: &results }
        });
        let results = results.into_inner();
        let portable = results.last().unwrap_or_else(|| panic!("no instruction set ran"));
        for (result, name) in results.iter().zip(&names) {
            for (a, b) in result.iter().zip(portable) {
                let scale = b.abs().max(1.0);
                assert!(
                    (a - b).abs() < 1e-3 * scale,
                    "{name} gives {a}, portable instructions {b}"
                );
            }
        }
        if let ["AVX-512", "AVX2", ..] = names[..] {
            assert!(
                results[0].iter().zip(&results[1]).all(|(a, b)| a.to_bits() == b.to_bits()),
                "AVX-512 and AVX2 give different bits"
            );
        }
    }
}
