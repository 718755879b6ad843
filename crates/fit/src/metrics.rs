//! The metrics of one iteration.

use field::Evaluations;
use serde::Serialize;

use multiview::calibrate::CameraDecision;

/// The metrics of one iteration: one line of `metrics.jsonl`.
#[derive(Clone, Debug, Serialize)]
pub struct Metrics {
    /// The number of finished iterations.
    pub iteration: u64,
    /// Wall time of all sessions of the run, in seconds.
    pub seconds: f64,
    /// The spent fraction of the budget, 0 to 1.
    pub progress: f64,
    /// Mean photometric loss per pixel.
    pub loss: f64,
    /// Mean of (|∇f| − 1)² over the points of the eikonal term.
    pub eikonal: f64,
    /// PSNR over the pixels of the iteration, in dB.
    pub train_psnr: f64,
    /// PSNR of the last preview of a held-out view at the size of the preview, in dB; `None` before
    /// the first preview, or without a held-out view.
    pub psnr: Option<f64>,
    /// Field evaluations of the iteration.
    pub evaluations: Evaluations,
    /// Traced rays per second.
    pub rays_per_second: f64,
    /// The fraction of the pixels that a silhouette may cross.
    pub edge_fraction: f64,
    /// The level of the pyramid: images at 1/2^level of their size.
    pub level: usize,
    /// The L2 norm of the gradient of the field and the radiance head, before clipping.
    pub gradient_norm: f64,
    /// The decision about the cameras before this iteration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trial: Option<CameraDecision>,
}
