//! Pixels per second of building the edges of a tile and of scattered pixels, and of adding fluxes.
#![allow(missing_docs, reason = "Criterion's macros make public functions")]

use std::hint::black_box;

use boundary::Edges;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

const PIXELS: u32 = 4096;

fn edges(c: &mut Criterion) {
    let tile: Vec<(u32, u32)> = (0..PIXELS).map(|i| (i % 64, i / 64)).collect();
    let scattered: Vec<(u32, u32)> =
        (0..PIXELS).map(|i| (i * 7919 % 1024, i * 104_729 % 1024)).collect();
    let mut group = c.benchmark_group("edges");
    group.throughput(Throughput::Elements(PIXELS.into())).sample_size(10);
    for (name, pixels) in [("of a tile", &tile), ("of scattered pixels", &scattered)] {
        group.bench_function(name, |b| b.iter(|| Edges::of(black_box(pixels), 1024, 1024)));
    }
    let (known, mut film) = (Edges::of(&tile, 1024, 1024), vec![[0.0; 3]; tile.len()]);
    group.bench_function("fluxes of a tile", |b| {
        b.iter(|| {
            known
                .as_slice()
                .iter()
                .for_each(|edge| edge.scatter(black_box([1.0, 2.0, 3.0]), &mut film))
        });
    });
    group.finish();
}

criterion_group!(benches, edges);
criterion_main!(benches);
