//! Whole images and derivative images of a ball, 64 × 64, one core, double precision.
#![allow(missing_docs, reason = "Criterion's macros make public functions")]

use std::hint::black_box;
use std::path::Path;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use estimate::{Direction, Method, Sampling, Setup, differentiate, render};
use scene::Scene;
use serde_json::json;

const SIDE: u32 = 64;

fn images(c: &mut Criterion) {
    let value = json!({
        "camera": {"width": SIDE, "height": SIDE, "focal": 128.0, "principal": [32, 32],
                   "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "sphere", "center": [0.05, 0.03, 0], "radius": 0.7},
        "appearance": {"type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.2, 0.2, 0.2],
                       "lights": [{"type": "directional", "direction": [0.3, 0.5, 0.8], "radiance": [1, 1, 1]}]},
        "background": [0, 0, 0]
    });
    let scene = Scene::from_value(Path::new("ball.json"), &value).unwrap_or_else(|e| panic!("{e}"));
    let field = scene.sdf.build::<f64>().unwrap_or_else(|e| panic!("{e}"));
    let shader = scene.shader::<f64>(&*field).unwrap_or_else(|e| panic!("{e}"));
    let cameras = [scene.camera];
    let setup = Setup::new(&*field, &*shader, &cameras, &scene.bounds, scene.background.into());
    let pool =
        rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap_or_else(|e| panic!("{e}"));
    let mut group = c.benchmark_group("ball");
    group.throughput(Throughput::Elements(u64::from(SIDE * SIDE))).sample_size(10);
    group.bench_function("image, 16 samples", |b| {
        b.iter(|| pool.install(|| render(black_box(&setup), 0, 16, 1, &|_| {}).is_ok()));
    });
    for (name, method) in Method::ALL {
        if matches!(method, Method::FiniteDifferences | Method::Contour) {
            continue;
        }
        let sampling = Sampling { method, spp: 16, edge_samples: 8, seed: 1 };
        group.bench_with_input(
            BenchmarkId::new("derivative, 16 samples", name),
            &sampling,
            |b, sampling| {
                b.iter(|| {
                    pool.install(|| {
                        differentiate(black_box(&setup), &[Direction::Field(3)], *sampling, &|_| {})
                            .is_ok()
                    })
                });
            },
        );
    }
    group.finish();
}

criterion_group!(benches, images);
criterion_main!(benches);
