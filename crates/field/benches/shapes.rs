//! Throughput of analytic shapes in points per second, on one core, in single precision.
#![allow(missing_docs, reason = "Criterion's macros make public functions")]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use field::{Csg, Field, Kind, Operation, Shape};
use glam::Vec3;

const POINTS: usize = 4096;

fn shapes(c: &mut Criterion) {
    let x: Vec<Vec3> =
        (0..POINTS).map(|i| Vec3::new((i as f32).sin(), (1.3 * i as f32).cos(), 0.2)).collect();
    let (mut f, mut g, mut h) =
        (vec![0.0; POINTS], vec![Vec3::ZERO; POINTS], vec![Vec3::ZERO; POINTS]);
    let ball = || Box::new(Shape::<f32>::sphere([0.1, 0.0, 0.0], 0.7));
    let torus =
        || Box::new(Shape::<f32>::new(Kind::Torus, &[0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.6, 0.2]));
    let fields: [(&str, Box<dyn Field<f32>>); 3] = [
        ("sphere", ball()),
        ("torus", torus()),
        ("subtraction", Box::new(Csg::new(Operation::Subtraction, vec![ball(), torus()]))),
    ];
    for (name, field) in fields {
        let mut group = c.benchmark_group(name);
        group.throughput(Throughput::Elements(POINTS as u64)).sample_size(10);
        group.bench_function("value", |b| b.iter(|| field.value(black_box(&x), &mut f)));
        group.bench_function("value_gradient", |b| {
            b.iter(|| field.value_gradient(black_box(&x), &mut f, &mut g))
        });
        group.bench_function("hessian_vector", |b| {
            b.iter(|| field.hessian_vector(black_box(&x), &x, &mut g, &mut h))
        });
        group.finish();
    }
}

criterion_group!(benches, shapes);
criterion_main!(benches);
