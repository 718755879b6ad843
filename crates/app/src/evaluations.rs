//! Field evaluations as reports and metrics show them.

use field::Evaluations;
use serde::Serialize;

/// How many points each kind of pass has seen.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct EvaluationReport {
    /// Values alone.
    pub value: u64,
    /// Values with gradients.
    pub gradient: u64,
    /// Hessian–vector products.
    pub hessian_vector: u64,
    /// Parameter passes.
    pub parameter: u64,
}

impl From<Evaluations> for EvaluationReport {
    fn from(e: Evaluations) -> Self {
        EvaluationReport {
            value: e.value,
            gradient: e.gradient,
            hessian_vector: e.hessian_vector,
            parameter: e.parameter,
        }
    }
}
