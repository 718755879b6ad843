//! Whole images and derivative images of a ball, 64 × 64, one core, double precision.
#![allow(missing_docs, reason = "Criterion's macros make public functions")]

use std::hint::black_box;
use std::path::Path;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use estimate::gradient::{Direction, Sampling, differentiate};
use estimate::{EstimatorOptions, Registry, SampleCounts};
use render::{Scene, render};
use scene::SceneFile;
use serde_json::json;

const SIDE: u32 = 64;

fn images(c: &mut Criterion) {
    let value = json!({
        "camera": {"width": SIDE, "height": SIDE, "focal": 128.0, "principal": [32, 32],
                   "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "sphere", "center": [0.05, 0.03, 0], "radius": 0.7},
        "appearance": {
            "type": "lambert", "albedo": [0.8, 0.6, 0.4], "ambient": [0.2, 0.2, 0.2],
            "lights": [{
                "type": "directional", "direction": [0.3, 0.5, 0.8], "radiance": [1, 1, 1]
            }]
        },
        "background": [0, 0, 0]
    });
    let file =
        SceneFile::from_value(Path::new("ball.json"), &value).unwrap_or_else(|e| panic!("{e}"));
    let field = file.field::<f64>().unwrap_or_else(|e| panic!("{e}"));
    let shader = file.shader::<f64>(&*field).unwrap_or_else(|e| panic!("{e}"));
    let cameras = [file.camera];
    let background = file.background().unwrap_or_else(|e| panic!("{e}"));
    let scene = Scene::new(&*field, &*shader, &cameras, &file.bounds, &*background);
    let pool =
        rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap_or_else(|e| panic!("{e}"));
    let mut group = c.benchmark_group("ball");
    group.throughput(Throughput::Elements(u64::from(SIDE * SIDE))).sample_size(10);
    group.bench_function("image, 16 samples", |b| {
        b.iter(|| pool.install(|| render(black_box(&scene), 0, 16, 1, &|_| {}).is_ok()));
    });
    let counts = SampleCounts { spp: 16, edge_samples: 8 };
    let sampling = Sampling { counts, seed: 1 };
    for entry in Registry::default().entries().iter().filter(|entry| entry.name != "contour") {
        let estimator = entry.estimator::<f64>(&EstimatorOptions::default());
        let id = BenchmarkId::new("derivative, 16 samples", entry.name);
        group.bench_with_input(id, &sampling, |b, sampling| {
            let directions = [Direction::Field(3)];
            let run = || {
                differentiate(black_box(&scene), &directions, &*estimator, *sampling, &|_| {})
                    .is_ok()
            };
            b.iter(|| pool.install(run));
        });
    }
    group.finish();
}

criterion_group!(benches, images);
criterion_main!(benches);
