//! The numbers that a fit reports of every iteration.

use field::Evaluations;
use serde::Serialize;

/// One line of `metrics.jsonl`.
#[derive(Clone, Debug, Serialize)]
pub struct Metrics {
    /// Iterations done.
    pub iteration: u64,
    /// Seconds spent in all.
    pub seconds: f64,
    /// The fraction of the budget spent.
    pub progress: f64,
    /// Mean photometric loss a pixel.
    pub loss: f64,
    /// Mean of (|∇f| − 1)².
    pub eikonal: f64,
    /// PSNR over the iteration's own pixels, dB.
    pub train_psnr: f64,
    /// PSNR of the held-out view last rendered, dB; absent without one.
    pub psnr: Option<f64>,
    /// Field evaluations of the iteration.
    pub evaluations: Evaluations,
    /// Rays traced a second.
    pub rays_per_second: f64,
    /// Fraction of the pixels that a silhouette may have crossed.
    pub edge_fraction: f64,
    /// The pyramid's level: images at 1/2^level.
    pub level: usize,
    /// The norm of the gradient before clipping.
    pub gradient_norm: f64,
}
