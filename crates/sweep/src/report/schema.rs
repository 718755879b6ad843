//! The tables of a sweep file.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use toml::Value;

/// How the program is built. The profiles give the same results in different times.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Profile {
    /// For measurements of time.
    #[default]
    Release,
    /// Compiles sooner and runs a little slower.
    Quick,
}

impl Profile {
    /// The profile's name in the workspace.
    pub fn name(self) -> &'static str {
        match self {
            Profile::Release => "release",
            Profile::Quick => "quick",
        }
    }
}

/// The limits of each process of a cell. A process that exceeds one is ended.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Wall time, in seconds.
    pub seconds: f64,
    /// Resident memory, in MiB.
    pub mebibytes: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Limits { seconds: 3600.0, mebibytes: 4096.0 }
    }
}

/// Options of `dsdf fit` with their values, by their names with underscores.
pub type Options = BTreeMap<String, Value>;

/// The criterion of convergence: all numbers are finite, the Chamfer distance is at most `chamfer`,
/// and the loss at the end is at most `rise` times the lowest loss.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Convergence {
    /// Largest Chamfer distance, in bounding radii.
    pub chamfer: f64,
    /// Largest ratio of the loss at the end to the lowest loss.
    pub rise: f64,
}

impl Default for Convergence {
    fn default() -> Self {
        Convergence { chamfer: 0.05, rise: 2.0 }
    }
}

/// The gradient test on the first and the last iterate of a cell. It compares the derivative image
/// of the silhouette (radiance 1 in front of a background of 0) with the contour integral. The
/// derivative is along a random direction of the weights.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct GradientTest {
    /// Width and height of the image, in pixels.
    pub size: u32,
    /// Samples per pixel.
    pub spp: u32,
    /// Runs, each with its own seed; 0 leaves the test out.
    pub runs: u32,
}

impl Default for GradientTest {
    fn default() -> Self {
        GradientTest { size: 16, spp: 16, runs: 8 }
    }
}

/// A data set: a scene of which views are rendered, or a folder of photographs.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DataSet {
    /// Its name in folders and reports.
    pub name: String,
    /// A scene file, relative to the sweep's folder.
    #[serde(default)]
    pub scene: Option<String>,
    /// Number of views of the scene.
    #[serde(default = "views")]
    pub views: u32,
    /// Width and height of a view, in pixels.
    #[serde(default = "size")]
    pub size: u32,
    /// A folder of photographs in place of a scene, relative to the sweep's folder.
    #[serde(default)]
    pub dataset: Option<String>,
    /// The true surface as a mesh, relative to the sweep's folder. A scene has its own without it.
    #[serde(default)]
    pub mesh: Option<String>,
}

impl DataSet {
    /// Whether the true surface is known.
    pub fn has_truth(&self) -> bool {
        self.scene.is_some() || self.mesh.is_some()
    }
}

fn views() -> u32 {
    24
}

fn size() -> u32 {
    64
}

/// A statement about a parameter, to be judged by the results.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Claim {
    /// The statement in words.
    pub text: String,
    /// The statement as a criterion.
    pub kind: ClaimKind,
    /// The parameter.
    pub parameter: String,
    /// The values that the statement is about.
    pub values: Vec<Value>,
    /// The value that they are compared with; `best` compares with every other value.
    #[serde(default)]
    pub than: Option<Value>,
    /// Values of other parameters: only cells with these values count.
    #[serde(default, rename = "where")]
    pub only: BTreeMap<String, Value>,
    /// The metric of the comparison.
    #[serde(default = "chamfer")]
    pub metric: String,
    /// The relative difference that matters.
    #[serde(default = "margin")]
    pub margin: f64,
}

fn chamfer() -> String {
    "chamfer".to_owned()
}

fn margin() -> f64 {
    0.1
}

/// The criterion of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClaimKind {
    /// The value is better than every other value.
    Best,
    /// The values are worse by the margin.
    Worse,
    /// The values are not better by the margin.
    LittleGain,
    /// A quarter or more of the fits do not converge.
    OftenDiverges,
}
