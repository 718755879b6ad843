//! Rays per second of the warp field, on one core in single precision, for several k.
#![allow(missing_docs, reason = "Criterion's macros make public functions")]

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use field::{Field, Shape};
use glam::{DVec3, Vec3};
use warp::{Pinhole, WarpOptions, WarpedRay, evaluate_with_divergence};

const RAYS: usize = 256;
const POINTS: usize = 22;

fn warps(c: &mut Criterion) {
    let ball = Shape::<f32>::sphere([0.0; 3], 1.0);
    let origin = Vec3::new(0.0, 0.0, 4.0);
    let (mut t, mut f, mut g) =
        (vec![3.0; RAYS * POINTS], vec![0.0; RAYS * POINTS], vec![Vec3::ZERO; RAYS * POINTS]);
    let direction =
        |r: usize| Vec3::new(0.26 + 0.02 * (r as f32 / RAYS as f32), 0.0, -1.0).normalize();
    for r in 0..RAYS {
        for i in r * POINTS..(r + 1) * POINTS {
            ball.value_gradient(&[origin + t[i] * direction(r)], &mut f[i..=i], &mut g[i..=i]);
            if i + 1 < (r + 1) * POINTS {
                t[i + 1] = t[i] + f[i];
            }
        }
    }
    let rays: Vec<WarpedRay<'_, f32>> = (0..RAYS)
        .map(|r| {
            let own = r * POINTS..(r + 1) * POINTS;
            WarpedRay {
                origin,
                direction: direction(r),
                direction_du: [Vec3::X, -Vec3::Y],
                entry_du: [0.0; 2],
                exit_du: [0.0; 2],
                relaxation: 1.0,
                t: &t[own.clone()],
                f: &f[own.clone()],
                gradient: &g[own.clone()],
                step: &f[own],
                clamped: false,
                valid: true,
            }
        })
        .collect();
    let chart = Pinhole::looking_at(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, DVec3::Y, 1.0);
    let charts: Vec<&Pinhole> = rays.iter().map(|_| &chart).collect();
    let weighting = WarpOptions::IMAGE.weighting::<f32>(1.0);
    let mut group = c.benchmark_group("a ball passed closely");
    group.throughput(Throughput::Elements(RAYS as u64)).sample_size(10);
    for k in [4, 7, 14, 22] {
        group.bench_with_input(BenchmarkId::new("V and its divergence, k", k), &k, |b, k| {
            let rays = black_box(&rays);
            b.iter(|| evaluate_with_divergence(&ball, &weighting, *k, &charts, rays));
        });
    }
    group.finish();
}

criterion_group!(benches, warps);
criterion_main!(benches);
