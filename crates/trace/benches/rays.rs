//! Rays per second on one core in single precision: a view of a ball, rays that graze it, and the
//! recorded recursion.
#![allow(missing_docs, reason = "Criterion's macros make public functions")]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use field::{Shape, Sphere};
use glam::Vec3;
use trace::{Options, Ray, intersect, visit};

/// N: the published number of quadrature points per ray.
const POINTS: usize = 22;

/// Rays along −z through `side` × `side` points of a square, from `center` − `half` to
/// `center` + `half` in x and from −`half` to `half` in y.
fn rays(side: usize, center: f32, half: f32) -> Vec<Ray<f32>> {
    let bounds = Sphere { center: Vec3::ZERO, radius: 1.2 };
    let at = |i: usize| (i as f32 + 0.5) / side as f32 * 2.0 - 1.0;
    let grid =
        (0..side * side).map(|i| Vec3::new(center + half * at(i % side), half * at(i / side), 4.0));
    grid.filter_map(|origin| Ray::enter(origin, -Vec3::Z, &bounds)).collect()
}

fn tracing(c: &mut Criterion) {
    let ball = Shape::<f32>::sphere([0.0; 3], 1.0);
    let (view, grazing, mut found) = (rays(64, 0.0, 1.2), rays(64, 1.0, 0.02), Vec::new());
    let mut group = c.benchmark_group("ball");
    group.sample_size(10);
    for (name, rays) in [("a view", &view), ("grazing", &grazing)] {
        group.throughput(Throughput::Elements(rays.len() as u64));
        group.bench_function(name, |b| {
            b.iter(|| intersect(&ball, black_box(rays), &Options::default(), &mut found))
        });
    }
    group.throughput(Throughput::Elements(view.len() as u64));
    group.bench_function("22 points of the recursion", |b| {
        b.iter(|| visit(&ball, black_box(&view), POINTS, 1.0))
    });
    group.finish();
}

criterion_group!(benches, tracing);
criterion_main!(benches);
