//! Derivative images: error and time, varying one parameter at a time.

use std::fmt::Write;
use std::path::Path;

use anyhow::ensure;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use sweep::measure::dsdf::gradient;
use sweep::measure::image::{Image, SquaredError};
use sweep::measure::reference::{GAUSSIAN, box_filtered, gaussian_filtered};
use sweep::measure::suite::{cases, scene};

/// A parameter of `dsdf gradient` with the values to measure.
pub(super) struct Axis {
    /// The name in tables and plots.
    pub(super) name: &'static str,
    /// The option of the parameter.
    flag: &'static str,
    /// Further options, at every value.
    base: &'static [&'static str],
    /// The values, as texts of the option.
    pub(super) values: &'static [&'static str],
    /// The value that `base` has without the option; empty if no value is.
    pub(super) default: &'static str,
}

/// The options of the published estimator.
const PAPER: &[&str] = &["--estimator", "paper"];

impl Axis {
    /// The options of all its measurements, as a person would type them.
    pub(super) fn options(&self) -> String {
        let (first, last) = (self.values.first(), self.values.last());
        let values = format!("{} to {}", first.unwrap_or(&""), last.unwrap_or(&""));
        let base: String = self.base.iter().map(|option| format!("{option} ")).collect();
        format!("{base}{} {values} --spp {} to {}", self.flag, SPP[0], SPP[SPP.len() - 1])
    }
}

/// The seeds of every measurement.
pub(super) fn seeds() -> impl Iterator<Item = u64> {
    (0..SEEDS).map(u64::from)
}

/// All parameters. Those of the published warp (N, k, γ, ε, λ_d) need its estimator.
/// For `refined`, edge samples are lines per pixel.
pub(super) const AXES: [Axis; 10] = [
    Axis {
        name: "estimator",
        flag: "--estimator",
        base: &[],
        values: &["interior", "paper", "paper-all", "gaussian", "was", "loubet", "band", "refined"],
        default: "",
    },
    Axis {
        name: "N",
        flag: "--steps",
        base: PAPER,
        values: &["6", "10", "22", "64", "200"],
        default: "22",
    },
    Axis {
        name: "k",
        flag: "--top-k",
        base: PAPER,
        values: &["2", "4", "7", "14", "22"],
        default: "14",
    },
    Axis {
        name: "gamma",
        flag: "--gamma",
        base: PAPER,
        values: &["1", "2", "3", "6", "8"],
        default: "3",
    },
    Axis {
        name: "epsilon",
        flag: "--epsilon",
        base: PAPER,
        values: &["0", "1e-8", "1e-6", "1e-4", "1e-2"],
        default: "1e-6",
    },
    Axis {
        name: "lambda_d",
        flag: "--lambda-d",
        base: PAPER,
        values: &["0.01", "0.1", "1", "10"],
        default: "1",
    },
    Axis {
        name: "edge samples",
        flag: "--edge-samples",
        base: &[],
        values: &["1", "4", "16", "64"],
        default: "",
    },
    Axis {
        name: "hit tolerance",
        flag: "--hit-tolerance",
        base: &[],
        values: &["1e-12", "1e-6", "1e-4", "1e-2"],
        default: "",
    },
    Axis {
        name: "relaxation",
        flag: "--relaxation",
        base: &[],
        values: &["1", "0.7", "0.4"],
        default: "1",
    },
    Axis {
        name: "precision",
        flag: "--precision",
        base: &[],
        values: &["f64", "f32"],
        default: "f64",
    },
];

/// Scenes of the suite: a lit ball, one outline behind another, a lit torus, a network.
const SCENES: [&str; 4] =
    ["off-axis.lambert", "occlusion.constant", "torus.lambert", "network.constant"];

/// Samples per pixel.
pub(super) const SPP: [u32; 3] = [4, 16, 64];

/// Runs of every measurement.
const SEEDS: u32 = 8;

/// The least number that counts in a geometric mean. A smaller bias cannot be told from none with
/// eight seeds.
const LEAST: f64 = 1e-4;

/// Time and relative L2 error of a setting: on one scene, or the geometric mean over the scenes.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
pub(super) struct Cost {
    /// Wall time of one run.
    pub(super) seconds: f64,
    /// The error of one run, root mean square over seeds and parameters.
    pub(super) error: f64,
    /// The error of the expected image, estimated.
    pub(super) bias: f64,
}

/// The measurements of an axis: for every value, one for each number of samples.
pub(super) type AxisMeasurements = Vec<Vec<Cost>>;

/// A scene with its reference images.
struct GradientScene {
    /// Its name in the suite.
    name: &'static str,
    scene: Value,
    /// JSON pointers to the parameters.
    wrt: Vec<String>,
    /// One image for each parameter, under the box filter and under the Gaussian filter.
    references: [Vec<Image>; 2],
}

/// All scenes of the measurements.
pub(super) struct GradientScenes {
    scenes: Vec<GradientScene>,
}

impl GradientScenes {
    /// Reads the scenes and computes their references.
    pub(super) fn new(binary: &Path) -> anyhow::Result<Self> {
        let mut scenes = Vec::new();
        for case in cases()? {
            let Some(name) = SCENES.into_iter().find(|name| *name == case.scene) else { continue };
            let scene = scene(name)?;
            let references = [
                box_filtered(binary, &scene, &case.wrt)?,
                gaussian_filtered(binary, &scene, &case.wrt)?,
            ];
            scenes.push(GradientScene { name, scene, wrt: case.wrt, references });
        }
        ensure!(scenes.len() == SCENES.len(), "the suite lacks one of {SCENES:?}");
        Ok(GradientScenes { scenes })
    }

    /// Measures all values of an axis. Adds rows to `csv`.
    pub(super) fn measure_axis(
        &self,
        binary: &Path,
        axis: &Axis,
        csv: &mut String,
    ) -> anyhow::Result<AxisMeasurements> {
        let mut measured = Vec::new();
        for value in axis.values {
            let mut of_value = Vec::new();
            for spp in SPP {
                let spp_text = spp.to_string();
                let flags = [axis.base, &[axis.flag, value, "--spp", &spp_text]].concat();
                let label = format!("{},{value},{spp}", axis.name);
                of_value.push(self.measure(binary, &flags, &label, csv)?);
            }
            measured.push(of_value);
        }
        Ok(measured)
    }

    /// Measures options on every scene: the geometric mean. Adds a row to `csv` for each scene; it
    /// starts with `label`.
    pub(super) fn measure(
        &self,
        binary: &Path,
        flags: &[&str],
        label: &str,
        csv: &mut String,
    ) -> anyhow::Result<Cost> {
        let gaussian = flags.iter().any(|f| GAUSSIAN.contains(f));
        let mut logs = [0.0; 3];
        for scene in &self.scenes {
            let Cost { seconds, error, bias } =
                scene.measure(binary, flags, usize::from(gaussian))?;
            let _ = writeln!(csv, "{label},{},{seconds:.6},{error:.6},{bias:.6}", scene.name);
            for (log, v) in logs.iter_mut().zip([seconds, error, bias]) {
                *log += v.max(LEAST).ln() / self.scenes.len() as f64;
            }
        }
        let [seconds, error, bias] = logs.map(f64::exp);
        Ok(Cost { seconds, error, bias })
    }
}

impl GradientScene {
    /// Measures options against the references under one filter: 0 for box, 1 for Gaussian.
    fn measure(&self, binary: &Path, flags: &[&str], filter: usize) -> anyhow::Result<Cost> {
        let mut runs = Vec::new();
        let mut seconds = 0.0;
        for seed in 0..SEEDS {
            let seed = seed.to_string();
            let flags = [flags, &["--seed", &seed]].concat();
            let run = gradient(binary, &self.scene, &self.wrt, &flags)?;
            seconds += run.seconds / f64::from(SEEDS);
            runs.push(run.images);
        }
        let (mut square, mut bias) = (0.0, 0.0);
        for (w, reference) in self.references[filter].iter().enumerate() {
            let images: Vec<&Image> = runs.iter().map(|run| &run[w]).collect();
            let error = SquaredError::of(&images, reference);
            let norm = reference.norm().powi(2) * self.wrt.len() as f64;
            square += error.run / norm;
            bias += error.bias / norm;
        }
        Ok(Cost { seconds, error: square.sqrt(), bias: bias.max(0.0).sqrt() })
    }
}
