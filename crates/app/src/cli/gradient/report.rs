//! The result of `dsdf gradient`.

use std::path::PathBuf;

use field::Evaluations;
use serde::Serialize;

/// The result of `dsdf gradient`.
#[derive(Serialize)]
pub(super) struct GradientReport {
    /// Wall time of the computation without start-up and file access, in seconds.
    pub(super) seconds: f64,
    /// Evaluations of the field.
    pub(super) evaluations: Evaluations,
    /// Relative L2 standard error, estimated from independent replicates: the largest of all
    /// derivatives. `None` if there was one replicate only.
    pub(super) standard_error: Option<f64>,
    /// The terms that the estimator leaves out for this scene. No standard error shows them.
    pub(super) unmodelled: Vec<&'static str>,
    /// One sentence for each thing that a user should know about the steps of finite differences.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) notes: Vec<String>,
    /// The files written.
    pub(super) outputs: Vec<PathBuf>,
    /// The loss, with `--target`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) loss: Option<f64>,
}
