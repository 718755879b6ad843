//! The tables of a sweep file.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use toml::Value;

use super::results::Row;

/// A build of the program: the results are the same, the seconds are not.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Profile {
    /// For measurements.
    #[default]
    Release,
    /// Built sooner, a little slower.
    Quick,
}

impl Profile {
    /// As cargo calls it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Profile::Release => "release",
            Profile::Quick => "quick",
        }
    }
}

/// What one process of a cell may use.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Limits {
    pub(super) seconds: f64,
    pub(super) mebibytes: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Limits { seconds: 3600.0, mebibytes: 4096.0 }
    }
}

/// When a fit counts as converged: all numbers finite, the Chamfer distance at most `chamfer`
/// bounding radii, and the loss at the end at most `rise` times the lowest.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Converged {
    pub(super) chamfer: f64,
    pub(super) rise: f64,
}

impl Converged {
    /// Whether a row converged. Without a true surface the loss alone says.
    pub(super) fn holds(&self, row: &Row, has_truth: bool) -> bool {
        let number = |name: &str| row.numbers.get(name).copied();
        let close = number("chamfer").map_or(!has_truth, |chamfer| chamfer <= self.chamfer);
        let loss = number("loss").zip(number("best_loss"));
        number("psnr").is_some() && close && loss.is_none_or(|(end, best)| end <= self.rise * best)
    }
}

impl Default for Converged {
    fn default() -> Self {
        Converged { chamfer: 0.05, rise: 2.0 }
    }
}

/// How gradients are tested on a cell's first and last iterate: the derivative image of the
/// silhouette (radiance 1 before 0) by a random direction of the weights, of `size` pixels a side
/// with `spp` samples, `runs` times, against contours.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct GradientTest {
    pub(super) size: u32,
    pub(super) spp: u32,
    pub(super) runs: u32,
}

impl Default for GradientTest {
    fn default() -> Self {
        GradientTest { size: 16, spp: 16, runs: 8 }
    }
}

/// A scene that is photographed, or a data set.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Data {
    pub(super) name: String,
    /// A scene file, beside the sweep's; `views` pictures of `size` pixels a side are taken of it.
    #[serde(default)]
    pub(super) scene: Option<String>,
    #[serde(default = "views")]
    pub(super) views: u32,
    #[serde(default = "size")]
    pub(super) size: u32,
    /// A folder with photographs instead.
    #[serde(default)]
    pub(super) dataset: Option<String>,
    /// Its true surface, if it is known.
    #[serde(default)]
    pub(super) mesh: Option<String>,
}

fn views() -> u32 {
    24
}

fn size() -> u32 {
    64
}

/// Something that was said of a parameter, to be judged.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Claim {
    pub(super) text: String,
    pub(super) kind: Kind,
    pub(super) parameter: String,
    /// The values that it speaks of.
    pub(super) values: Vec<Value>,
    /// The value that they are compared with; for `best` every other one.
    #[serde(default)]
    pub(super) than: Option<Value>,
    /// Only cells with these values of other parameters.
    #[serde(default, rename = "where")]
    pub(super) only: BTreeMap<String, Value>,
    #[serde(default = "chamfer")]
    pub(super) metric: String,
    /// The relative difference that counts.
    #[serde(default = "margin")]
    pub(super) margin: f64,
}

fn chamfer() -> String {
    "chamfer".to_owned()
}

fn margin() -> f64 {
    0.1
}

/// What a claim says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Kind {
    /// The value is better than every other.
    Best,
    /// The values are worse by the margin.
    Worse,
    /// The values are not better by the margin.
    LittleGain,
    /// A quarter or more of the fits do not converge.
    OftenDiverges,
}

impl Data {
    /// Whether the true surface is known.
    pub(super) fn has_truth(&self) -> bool {
        self.scene.is_some() || self.mesh.is_some()
    }
}
