//! The metrics of one iteration.

use field::Evaluations;
use multiview::calibrate::CameraDecision;
use serde::ser::{Serialize, SerializeStruct, Serializer};

/// The measurements that one iteration makes itself: the result of [`Fit::step`](crate::Fit::step).
#[derive(Clone, Debug)]
pub struct StepMetrics {
    /// The number of finished iterations.
    pub iteration: u64,
    /// Mean photometric loss per pixel.
    pub loss: f64,
    /// Mean of (|∇f| − 1)² over the points of the eikonal term.
    pub eikonal: f64,
    /// PSNR over the pixels of the iteration, in dB.
    pub train_psnr: f64,
    /// Field evaluations of the iteration.
    pub evaluations: Evaluations,
    /// The number of traced rays.
    pub rays: u64,
    /// The fraction of the pixels that a silhouette may cross.
    pub edge_fraction: f64,
    /// The level of the pyramid: images at 1/2^level of their size.
    pub level: usize,
    /// The L2 norm of the gradient of the field and the radiance head, before clipping.
    pub gradient_norm: f64,
    /// The decision about the cameras before this iteration.
    pub trial: Option<CameraDecision>,
}

/// The metrics of one iteration of a [`Session`](crate::Session), which has a clock and previews:
/// one line of `metrics.jsonl`.
#[derive(Clone, Debug)]
pub struct Metrics {
    /// The measurements of the iteration itself.
    pub step: StepMetrics,
    /// Wall time of all sessions of the run, in seconds.
    pub seconds: f64,
    /// The spent fraction of the budget, 0 to 1.
    pub progress: f64,
    /// PSNR of the last preview of a held-out view at the size of the preview, in dB; `None` before
    /// the first preview, or without a held-out view.
    pub psnr: Option<f64>,
    /// Traced rays per second.
    pub rays_per_second: f64,
}

/// The line of `metrics.jsonl`: the order of its fields is a contract with programs that read it.
impl Serialize for Metrics {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Metrics { step, seconds, progress, psnr, rays_per_second } = self;
        let fields = 12 + usize::from(step.trial.is_some());
        let mut line = serializer.serialize_struct("Metrics", fields)?;
        line.serialize_field("iteration", &step.iteration)?;
        line.serialize_field("seconds", seconds)?;
        line.serialize_field("progress", progress)?;
        line.serialize_field("loss", &step.loss)?;
        line.serialize_field("eikonal", &step.eikonal)?;
        line.serialize_field("train_psnr", &step.train_psnr)?;
        line.serialize_field("psnr", psnr)?;
        line.serialize_field("evaluations", &step.evaluations)?;
        line.serialize_field("rays_per_second", rays_per_second)?;
        line.serialize_field("edge_fraction", &step.edge_fraction)?;
        line.serialize_field("level", &step.level)?;
        line.serialize_field("gradient_norm", &step.gradient_norm)?;
        if let Some(trial) = &step.trial {
            line.serialize_field("trial", trial)?;
        }
        line.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_its_fields_in_order() {
        let step = StepMetrics {
            iteration: 7,
            loss: 0.5,
            eikonal: 0.25,
            train_psnr: 20.0,
            evaluations: Evaluations::default(),
            rays: 100,
            edge_fraction: 0.125,
            level: 1,
            gradient_norm: 3.0,
            trial: None,
        };
        let mut metrics =
            Metrics { step, seconds: 2.0, progress: 0.75, psnr: None, rays_per_second: 50.0 };
        let evaluations = serde_json::to_string(&Evaluations::default()).unwrap();
        let line = format!(
            r#"{{"iteration":7,"seconds":2.0,"progress":0.75,"loss":0.5,"eikonal":0.25,"train_psnr":20.0,"psnr":null,"evaluations":{evaluations},"rays_per_second":50.0,"edge_fraction":0.125,"level":1,"gradient_norm":3.0}}"#
        );
        assert_eq!(serde_json::to_string(&metrics).unwrap(), line);

        let trial = CameraDecision::TooShort { iterations: 3, least: 9 };
        metrics.step.trial = Some(trial);
        let trial = serde_json::to_string(&trial).unwrap();
        let end = line.trim_end_matches('}');
        let expected = format!(r#"{end},"trial":{trial}}}"#);
        assert_eq!(serde_json::to_string(&metrics).unwrap(), expected);
    }
}
