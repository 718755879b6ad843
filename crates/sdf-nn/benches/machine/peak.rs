//! Measures the peak of fused multiply–adds of one core.
#![allow(
    unsafe_code,
    reason = "calls of functions compiled for instructions that were detected at run time"
)]

use std::hint::black_box;
use std::time::Instant;

use serde::Serialize;

/// The peak of one core in single precision.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Peak {
    pub(crate) instructions: &'static str,
    pub(crate) gflops: f64,
}

/// Independent sums: a latency of 4 cycles and two units need at least 8.
const CHAINS: usize = 16;

/// Rounds of one measurement.
const ROUNDS: u64 = 10_000_000;

/// The number of measurements; the fastest counts.
const TRIES: usize = 5;

impl Peak {
    /// Measures with the widest vectors of this machine.
    pub(crate) fn measure() -> Peak {
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") {
                let run = || {
                    // SAFETY: AVX-512 F was detected.
                    unsafe { avx512() }
                };
                return Peak { instructions: "AVX-512", gflops: best(16, run) };
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                let run = || {
                    // SAFETY: AVX2 and FMA were detected.
                    unsafe { avx2() }
                };
                return Peak { instructions: "AVX2 and FMA", gflops: best(8, run) };
            }
        }
        Peak { instructions: "portable", gflops: best(4, portable) }
    }
}

/// GFLOP/s of a function that runs `ROUNDS` rounds of `CHAINS` multiply–adds on registers of
/// `lanes` numbers.
fn best(lanes: usize, run: impl Fn() -> f32) -> f64 {
    let seconds = (0..TRIES).map(|_| {
        let start = Instant::now();
        black_box(run());
        start.elapsed().as_secs_f64()
    });
    let operations = 2.0 * ROUNDS as f64 * (CHAINS * lanes) as f64;
    operations / seconds.fold(f64::INFINITY, f64::min) / 1e9
}

/// `ROUNDS` × `CHAINS` multiply–adds of 16 numbers.
///
/// # Safety
/// The machine must have AVX-512 F.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn avx512() -> f32 {
    use std::arch::x86_64::{_mm512_add_ps, _mm512_fmadd_ps, _mm512_reduce_add_ps, _mm512_set1_ps};
    let (a, b) = (_mm512_set1_ps(black_box(0.999_999)), _mm512_set1_ps(black_box(1e-7)));
    let mut sums = [_mm512_set1_ps(1.0); CHAINS];
    for _ in 0..ROUNDS {
        for sum in &mut sums {
            *sum = _mm512_fmadd_ps(*sum, a, b);
        }
    }
    _mm512_reduce_add_ps(
        sums.into_iter().fold(_mm512_set1_ps(0.0), |total, sum| _mm512_add_ps(total, sum)),
    )
}

/// `ROUNDS` × `CHAINS` multiply–adds of 8 numbers.
///
/// # Safety
/// The machine must have AVX2 and FMA.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn avx2() -> f32 {
    use std::arch::x86_64::{
        _mm_cvtss_f32, _mm256_add_ps, _mm256_castps256_ps128, _mm256_fmadd_ps, _mm256_set1_ps,
    };
    let (a, b) = (_mm256_set1_ps(black_box(0.999_999)), _mm256_set1_ps(black_box(1e-7)));
    // AVX2 has 16 registers: 12 sums leave room for the constants.
    let mut sums = [_mm256_set1_ps(1.0); 12];
    for _ in 0..ROUNDS * CHAINS as u64 / 12 {
        for sum in &mut sums {
            *sum = _mm256_fmadd_ps(*sum, a, b);
        }
    }
    _mm_cvtss_f32(_mm256_castps256_ps128(
        sums.into_iter().fold(_mm256_set1_ps(0.0), |t, s| _mm256_add_ps(t, s)),
    ))
}

/// `ROUNDS` × `CHAINS` multiply–adds of 4 numbers, fused only where that is one instruction.
fn portable() -> f32 {
    let (a, b) = (black_box(0.999_999), black_box(1e-7));
    let mut sums = [[1.0f32; 4]; CHAINS];
    for _ in 0..ROUNDS {
        for sum in &mut sums {
            for s in sum {
                *s = if cfg!(target_arch = "aarch64") { s.mul_add(a, b) } else { *s * a + b };
            }
        }
    }
    sums.iter().flatten().sum()
}
