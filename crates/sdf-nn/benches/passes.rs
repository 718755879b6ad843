//! Throughput of every pass in points per second, on one core, in single precision.
//!
//! The bench `machine` compares them with the machine's peak.
#![allow(missing_docs, reason = "Criterion's macros make public functions")]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use field::Field;
use glam::Vec3;
use random::Stream;
use sdf_nn::{Activation, Architecture, Encoding, Network, Transform};

const POINTS: usize = 4096;

fn network(width: usize, layers: usize) -> Network<f32> {
    let architecture = Architecture {
        encoding: Encoding::Frequency { bands: 6 },
        grid: sdf_nn::SplineSize::none(),
        hidden: vec![width; layers],
        skip: vec![],
        activation: Activation::Softplus { beta: 100.0 },
    };
    Network::geometric(architecture, Transform::default(), 0.5, Stream::of_seed(1))
}

fn passes(c: &mut Criterion) {
    let x: Vec<Vec3> = (0..POINTS)
        .map(|i| Vec3::new((i as f32).sin(), (1.3 * i as f32).cos(), 0.2) * 0.7)
        .collect();
    let (mut f, mut g, mut h) =
        (vec![0.0; POINTS], vec![Vec3::ZERO; POINTS], vec![Vec3::ZERO; POINTS]);
    for (width, layers) in [(64, 3), (64, 4), (256, 8)] {
        let net = network(width, layers);
        let mut theta = vec![0.0; net.parameters().len()];
        let multiply_adds = net.parameters().len();
        let mut group =
            c.benchmark_group(format!("{width}x{layers}, {multiply_adds} multiply-adds per point"));
        group.throughput(Throughput::Elements(POINTS as u64)).sample_size(10);
        group.bench_function("value", |b| b.iter(|| net.value(black_box(&x), &mut f)));
        group.bench_function("value_gradient", |b| {
            b.iter(|| net.value_gradient(black_box(&x), &mut f, &mut g))
        });
        group.bench_function("hessian_vector", |b| {
            b.iter(|| net.hessian_vector(black_box(&x), &x, &mut g, &mut h))
        });
        group.bench_function("parameter_vjp", |b| {
            b.iter(|| net.parameter_vjp(black_box(&x), &f, &x, &mut theta))
        });
        group.finish();
    }
}

/// Batches of few points, as the tracer of a fit has them in its last steps.
fn few(c: &mut Criterion) {
    let net = network(64, 3);
    for count in [1, 2, 4, 8, 16, 24] {
        let x: Vec<Vec3> =
            (0..count).map(|i| Vec3::new((i as f32).sin(), 0.3, 0.2) * 0.7).collect();
        let (mut f, mut g) = (vec![0.0; count], vec![Vec3::ZERO; count]);
        let mut group = c.benchmark_group(format!("64x3, {count} points"));
        group.throughput(Throughput::Elements(count as u64));
        group.bench_function("value", |b| b.iter(|| net.value(black_box(&x), &mut f)));
        group.bench_function("value_gradient", |b| {
            b.iter(|| net.value_gradient(black_box(&x), &mut f, &mut g))
        });
        group.finish();
    }
}

criterion_group!(benches, passes, few);
criterion_main!(benches);
