//! Derivative images: error over time, one parameter at a time.

use std::fmt::Write;
use std::path::Path;

use anyhow::ensure;
use serde_json::Value;

use measure::dsdf::{Image, Spread, gradient, scene, suite};
use measure::reference::{GAUSSIAN, box_filtered, gaussian_filtered};

/// A parameter with the values that are tried, all else as `base` says.
pub(super) struct Axis {
    pub(super) name: &'static str,
    flag: &'static str,
    base: &'static [&'static str],
    pub(super) values: &'static [&'static str],
    /// The one of them that the base has anyway.
    pub(super) default: &'static str,
}

const PAPER: &[&str] = &["--estimator", "paper"];

/// What is varied. The five of the published warp need that estimator; edge samples are lines a
/// pixel in `refined`.
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

/// Samples a pixel.
pub(super) const SPP: [u32; 3] = [4, 16, 64];

/// Runs of every cell.
const SEEDS: u32 = 8;

/// A setting with a number of samples, over the scenes: geometric means.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub(super) seconds: f64,
    /// The relative L2 error of a run, root mean square.
    pub(super) error: f64,
    /// That of the mean over infinitely many seeds, estimated.
    pub(super) bias: f64,
}

/// The cells of an axis: by value, then by samples.
pub(super) type Cells = Vec<Vec<Cell>>;

/// A scene with its reference images under both filters.
struct Subject {
    name: &'static str,
    scene: Value,
    wrt: Vec<String>,
    references: [Vec<Image>; 2],
}

pub(super) struct Gradients {
    subjects: Vec<Subject>,
}

impl Gradients {
    pub(super) fn new(binary: &Path) -> anyhow::Result<Self> {
        let mut subjects = Vec::new();
        for case in suite()? {
            let Some(name) = SCENES.into_iter().find(|name| *name == case.scene) else { continue };
            let scene = scene(name)?;
            let references = [
                box_filtered(binary, &scene, &case.wrt)?,
                gaussian_filtered(binary, &scene, &case.wrt)?,
            ];
            subjects.push(Subject { name, scene, wrt: case.wrt, references });
        }
        ensure!(subjects.len() == SCENES.len(), "the suite lacks one of {SCENES:?}");
        Ok(Gradients { subjects })
    }

    /// Measures an axis; rows are added to `csv`.
    pub(super) fn measure(
        &self,
        binary: &Path,
        axis: &Axis,
        csv: &mut String,
    ) -> anyhow::Result<Cells> {
        let mut cells = Vec::new();
        for value in axis.values {
            let mut ladder = Vec::new();
            for spp in SPP {
                let spp_text = spp.to_string();
                let flags = [axis.base, &[axis.flag, value, "--spp", &spp_text]].concat();
                ladder.push(self.cell(
                    binary,
                    &flags,
                    &format!("{},{value},{spp}", axis.name),
                    csv,
                )?);
            }
            cells.push(ladder);
        }
        Ok(cells)
    }

    /// Measures flags on every scene.
    pub(super) fn cell(
        &self,
        binary: &Path,
        flags: &[&str],
        label: &str,
        csv: &mut String,
    ) -> anyhow::Result<Cell> {
        let gaussian = flags.iter().any(|f| GAUSSIAN.contains(f));
        let mut logs = [0.0; 3];
        for subject in &self.subjects {
            let cell = subject.cell(binary, flags, usize::from(gaussian))?;
            let _ = writeln!(
                csv,
                "{label},{},{:.6},{:.6},{:.6}",
                subject.name, cell.seconds, cell.error, cell.bias
            );
            for (log, v) in logs.iter_mut().zip([cell.seconds, cell.error, cell.bias]) {
                *log += v.max(LEAST).ln() / self.subjects.len() as f64;
            }
        }
        let [seconds, error, bias] = logs.map(f64::exp);
        Ok(Cell { seconds, error, bias })
    }
}

/// A bias below this cannot be told from none with this many seeds.
const LEAST: f64 = 1e-4;

impl Subject {
    fn cell(&self, binary: &Path, flags: &[&str], filter: usize) -> anyhow::Result<Cell> {
        let mut runs = Vec::new();
        let mut seconds = 0.0;
        for seed in 0..SEEDS {
            let seed = seed.to_string();
            let run =
                gradient(binary, &self.scene, &self.wrt, &[flags, &["--seed", &seed]].concat())?;
            seconds += run.seconds / f64::from(SEEDS);
            runs.push(run.images);
        }
        let (mut square, mut bias) = (0.0, 0.0);
        for (w, reference) in self.references[filter].iter().enumerate() {
            let spread = Spread::of(&runs.iter().map(|run| &run[w]).collect::<Vec<_>>(), reference);
            let norm = reference.norm().powi(2) * self.wrt.len() as f64;
            square += spread.run / norm;
            bias += spread.bias / norm;
        }
        Ok(Cell { seconds, error: square.sqrt(), bias: bias.max(0.0).sqrt() })
    }
}
