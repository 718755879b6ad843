//! What can be chosen of a fit: flags, `fit.toml` and documentation in one struct.

use std::path::Path;
use std::time::Duration;

use field::Sphere;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use estimate::{Control, Estimator, Method};
use io::InputError;

/// Options of `dsdf fit`. The defaults need no tuning; a run's `fit.toml` records all of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, clap::Args)]
#[serde(default, deny_unknown_fields)]
pub struct FitOptions {
    /// Number of iterations; without it and without --time, a number that suits most scenes
    #[arg(long)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub iterations: Option<u64>,
    /// Wall time to spend, for example 90s, 10m or 1h30m; the schedule follows the clock
    #[arg(long, conflicts_with = "iterations", value_parser = parse_duration)]
    #[serde(skip_serializing_if = "Option::is_none", with = "seconds")]
    pub time: Option<Duration>,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Read images at 1/N of their size
    #[arg(long, default_value_t = 1)]
    pub downscale: u32,
    /// Use masks or alpha in the loss, not in evaluation only
    #[arg(long)]
    pub use_masks: bool,
    /// Bounding sphere x,y,z,radius in world units, instead of the one found
    #[arg(long, value_parser = parse_bounds, allow_hyphen_values = true)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bounds: Option<[f64; 4]>,
    /// Width of the network's hidden layers
    #[arg(long, default_value_t = 64)]
    pub width: usize,
    /// Number of the network's hidden layers
    #[arg(long, default_value_t = 3)]
    pub layers: usize,
    /// Octaves of the network's frequency encoding
    #[arg(long, default_value_t = 6)]
    pub bands: usize,
    /// Sharpness of the softplus, per unit of pre-activation
    #[arg(long, default_value_t = 100.0)]
    pub beta: f64,
    /// Radius of the initial sphere, as a fraction of the bounding radius
    #[arg(long, default_value_t = 0.5)]
    pub initial_radius: f64,
    /// Adam's learning rate at its peak
    #[arg(long, default_value_t = 2e-3)]
    pub learning_rate: f64,
    /// Pixels an iteration
    #[arg(long, default_value_t = 1024)]
    pub batch: usize,
    /// How pixels are differentiated that a silhouette may cross: see `dsdf gradient --estimator`
    #[arg(long, default_value = "refined")]
    pub estimator: Method,
    /// Samples of a pixel that a silhouette may cross
    #[arg(long, default_value_t = 4)]
    pub edge_rays: u32,
    /// Samples on each border edge of such a pixel
    #[arg(long, default_value_t = 1)]
    pub edge_samples: u32,
    /// N: points of the warp's quadrature along a ray
    #[arg(long, default_value_t = 22)]
    pub steps: usize,
    /// k: points that keep a weight
    #[arg(long, default_value_t = 7)]
    pub top_k: usize,
    /// γ: exponent of the weights
    #[arg(long, default_value_t = 3.0)]
    pub gamma: f64,
    /// λ_d: weight of |∇f·d| beside |f|, in bounding radii
    #[arg(long, default_value_t = 0.02)]
    pub lambda_d: f64,
    /// ε: guard inside the weights, in world units at a bounding radius of 1
    #[arg(long, default_value_t = 1e-6)]
    pub epsilon: f64,
    /// Weight of the eikonal term (|∇f| − 1)²
    #[arg(long, default_value_t = 0.1)]
    pub eikonal: f64,
    /// Weight of the term that clears what looks like the background, at the start
    #[arg(long, default_value_t = 4.0)]
    pub background_weight: f64,
    /// Iterations between checkpoints
    #[arg(long, default_value_t = 200)]
    pub checkpoint_every: u64,
    /// Iterations between preview pictures
    #[arg(long, default_value_t = 500)]
    pub preview_every: u64,
}

/// Iterations when neither --iterations nor --time is given.
pub const DEFAULT_ITERATIONS: u64 = 6000;

impl Default for FitOptions {
    fn default() -> Self {
        #[derive(clap::Parser)]
        struct Flags {
            #[command(flatten)]
            options: FitOptions,
        }
        <Flags as clap::Parser>::parse_from(["fit"]).options
    }
}

/// A named condition on an option: flag, value found, whether it holds, what it should be.
type Check = (&'static str, String, bool, &'static str);

impl FitOptions {
    /// Checks every number; `source` is where they came from, for the message.
    ///
    /// # Errors
    /// On the first value that cannot work.
    pub fn validate(&self, source: &Path) -> Result<(), InputError> {
        let positive = |name, value: f64| -> Check {
            (name, value.to_string(), value > 0.0 && value.is_finite(), "a number above 0")
        };
        let at_least_one =
            |name, value: u64| -> Check { (name, value.to_string(), value >= 1, "1 or more") };
        // As many as `gradient` takes.
        let count = |name, value: u64| -> Check {
            (name, value.to_string(), (1..=65536).contains(&value), "1 to 65536")
        };
        let not_negative = |name, value: f64| -> Check {
            (name, value.to_string(), value >= 0.0 && value.is_finite(), "0 or more")
        };
        let radius = self.initial_radius;
        let checks = [
            at_least_one("iterations", self.iterations.unwrap_or(1)),
            at_least_one("downscale", self.downscale.into()),
            ("width", self.width.to_string(), (1..=4096).contains(&self.width), "1 to 4096"),
            ("layers", self.layers.to_string(), (1..=64).contains(&self.layers), "1 to 64"),
            ("bands", self.bands.to_string(), self.bands <= 12, "at most 12"),
            positive("beta", self.beta),
            (
                "initial_radius",
                radius.to_string(),
                radius > 0.0 && radius < 1.0,
                "a fraction between 0 and 1",
            ),
            positive("learning_rate", self.learning_rate),
            at_least_one("batch", self.batch as u64),
            (
                "estimator",
                self.estimator.name().to_owned(),
                self.estimator != Method::FiniteDifferences,
                "an estimator of parameter gradients",
            ),
            count("edge_rays", self.edge_rays.into()),
            count("edge_samples", self.edge_samples.into()),
            count("steps", self.steps as u64),
            (
                "top_k",
                self.top_k.to_string(),
                self.top_k >= 2,
                "2 or more (one point alone keeps no weight)",
            ),
            positive("gamma", self.gamma),
            not_negative("lambda_d", self.lambda_d),
            not_negative("epsilon", self.epsilon),
            not_negative("eikonal", self.eikonal),
            not_negative("background_weight", self.background_weight),
            at_least_one("checkpoint_every", self.checkpoint_every),
            at_least_one("preview_every", self.preview_every),
        ];
        match checks.into_iter().find(|(_, _, holds, _)| !holds) {
            Some((name, found, _, expected)) => Err(InputError::new(source, name, found, expected)),
            None => Ok(()),
        }
    }

    /// The estimator of pixels that a silhouette may cross.
    ///
    /// # Panics
    /// For options that [`validate`](Self::validate) refuses.
    pub(crate) fn estimator(&self) -> Box<dyn Estimator<f32>> {
        let estimator = self.estimator.estimator(self.edge_rays, self.edge_samples, Control::Mean);
        estimator.unwrap_or_else(|| {
            panic!("{} is no estimator of parameter gradients", self.estimator.name())
        })
    }

    /// The bounding sphere asked for, if any.
    pub fn bounds(&self) -> Option<Sphere<f64>> {
        self.bounds.map(|[x, y, z, radius]| Sphere { center: DVec3::new(x, y, z), radius })
    }
}

/// A duration such as 90s, 10m or 1h30m.
///
/// # Errors
/// With what was expected.
pub fn parse_duration(text: &str) -> Result<Duration, String> {
    let duration = humantime::parse_duration(text).map_err(|e| e.to_string())?;
    if duration.is_zero() { Err("a time above 0".to_owned()) } else { Ok(duration) }
}

/// A sphere as x,y,z,radius.
///
/// # Errors
/// With what was expected.
pub fn parse_bounds(text: &str) -> Result<[f64; 4], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse::<f64>()).collect();
    match numbers.ok().and_then(|n| <[f64; 4]>::try_from(n).ok()) {
        Some(b) if b.iter().all(|v| v.is_finite()) && b[3] > 0.0 => Ok(b),
        _ => Err("expected x,y,z,radius with a radius above 0".to_owned()),
    }
}

/// Durations in `fit.toml`: seconds.
mod seconds {
    use super::Duration;
    use serde::{Deserialize, Deserializer, Serializer};

    #[allow(clippy::ref_option, reason = "the signature serde asks for")]
    pub(super) fn serialize<S: Serializer>(
        time: &Option<Duration>,
        s: S,
    ) -> Result<S::Ok, S::Error> {
        match time {
            Some(time) => s.serialize_f64(time.as_secs_f64()),
            None => s.serialize_none(),
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        d: D,
    ) -> Result<Option<Duration>, D::Error> {
        let seconds = Option::<f64>::deserialize(d)?;
        seconds.map(Duration::try_from_secs_f64).transpose().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_survive_toml() {
        let mut options =
            FitOptions { time: Some(Duration::from_secs(600)), ..FitOptions::default() };
        options.bounds = Some([0.0, 1.0, 2.0, 3.0]);
        let text = toml::to_string(&options).unwrap();
        assert_eq!(toml::from_str::<FitOptions>(&text).unwrap(), options);
    }

    #[test]
    fn impossible_values_are_named() {
        let source = Path::new("arguments");
        let cases = [
            (FitOptions { top_k: 1, ..FitOptions::default() }, "top_k"),
            (FitOptions { gamma: f64::NAN, ..FitOptions::default() }, "gamma"),
            (FitOptions { batch: 0, ..FitOptions::default() }, "batch"),
        ];
        for (options, name) in cases {
            assert_eq!(options.validate(source).unwrap_err().field, name);
        }
        FitOptions::default().validate(source).unwrap();
    }

    #[test]
    fn bounds_need_four_numbers() {
        assert_eq!(parse_bounds("1,2,-3,0.5"), Ok([1.0, 2.0, -3.0, 0.5]));
        for text in ["", "1,2,3", "1,2,3,0", "1,2,3,nan", "a,b,c,d"] {
            assert!(parse_bounds(text).is_err(), "{text}");
        }
    }
}
