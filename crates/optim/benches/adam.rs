//! Parameters per second of one Adam step and of clipping, on one core in single precision.
#![allow(missing_docs, reason = "Criterion's macros make public functions")]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use optim::{Adam, Group, clip_norm};

const PARAMETERS: usize = 1 << 16;

fn steps(c: &mut Criterion) {
    let mut adam = Adam::<f32>::new(PARAMETERS, vec![Group::new("all", 0..PARAMETERS)]);
    let mut parameters = vec![0.5; PARAMETERS];
    let mut gradient: Vec<f32> = (0..PARAMETERS).map(|i| (i as f32).sin()).collect();
    let mut group = c.benchmark_group("65536 parameters");
    group.throughput(Throughput::Elements(PARAMETERS as u64)).sample_size(10);
    group.bench_function("step", |b| {
        b.iter(|| adam.step(black_box(&mut parameters), &gradient, 1e-3))
    });
    group.bench_function("clip", |b| b.iter(|| clip_norm(black_box(&mut gradient), 1e3)));
    group.finish();
}

criterion_group!(benches, steps);
criterion_main!(benches);
