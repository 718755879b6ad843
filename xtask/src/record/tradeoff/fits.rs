//! Fits with different networks and presets: time and quality.

use std::path::Path;

use anyhow::Context;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use sweep::measure::dsdf::run_json;
use sweep::measure::workspace_root;

/// Options of `dsdf fit` under a name.
pub(super) struct FitSetting {
    /// The name in tables.
    pub(super) name: &'static str,
    /// The options.
    pub(super) flags: &'static [&'static str],
}

/// Networks (hidden layers × width), each fitted for 40 seconds.
pub(super) const NETWORKS: [FitSetting; 5] = [
    FitSetting { name: "3 × 32", flags: &["--width", "32", "--time", "40s"] },
    FitSetting { name: "3 × 64", flags: &["--time", "40s"] },
    FitSetting { name: "3 × 128", flags: &["--width", "128", "--time", "40s"] },
    FitSetting { name: "2 × 64", flags: &["--layers", "2", "--time", "40s"] },
    FitSetting { name: "4 × 64", flags: &["--layers", "4", "--time", "40s"] },
];

/// The presets of `dsdf fit`.
pub(super) const PRESETS: [FitSetting; 3] = [
    FitSetting { name: "fast", flags: &["--preset", "fast"] },
    FitSetting { name: "balanced", flags: &["--preset", "balanced"] },
    FitSetting { name: "accurate", flags: &["--preset", "accurate"] },
];

/// Cost and quality of a fit.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(super) struct FitOutcome {
    /// Wall time of the fit, in seconds.
    pub(super) seconds: f64,
    /// Iterations of the fit.
    pub(super) iterations: u64,
    /// Of held-out views, in dB.
    pub(super) psnr: f64,
    /// Chamfer distance in bounding radii.
    pub(super) chamfer: f64,
}

/// How the data set is made and the fits are measured, as a person would type it.
pub(super) const DATA: &str = "DATA by dsdf synth crates/app/src/cli/demo_scene.json --views 24 \
                               --size 128x128; errors by dsdf eval RUN --mesh DATA/truth.ply";

/// Renders 24 views of the demo's scene as a data set, and returns its folder.
fn photographs(binary: &Path, folder: &Path) -> anyhow::Result<String> {
    let data = folder.join("dataset").to_string_lossy().into_owned();
    let scene =
        workspace_root().join("crates/app/src/cli/demo_scene.json").to_string_lossy().into_owned();
    run_json(binary, &["synth", &scene, "-o", &data, "--views", "24", "--size", "128x128"])?;
    Ok(data)
}

/// Fits a data set in the folder `scratch`, and evaluates the fit.
pub(super) fn measure(
    binary: &Path,
    scratch: &Path,
    setting: &FitSetting,
) -> anyhow::Result<FitOutcome> {
    // A measurement that was killed leaves its files.
    let folder = tempfile::tempdir_in(scratch)?;
    let data = photographs(binary, folder.path())?;
    let run = folder.path().join("run").to_string_lossy().into_owned();
    let fit = run_json(binary, &[&["fit", &data, "-o", &run], setting.flags].concat())?;
    let truth = Path::new(&data).join("truth.ply").to_string_lossy().into_owned();
    let quality = run_json(binary, &["eval", &run, "--mesh", &truth])?;
    let number = |value: &Value, key: &'static str| value[key].as_f64().context(key);
    Ok(FitOutcome {
        seconds: number(&fit, "seconds")?,
        iterations: fit["iterations"].as_u64().context("iterations")?,
        psnr: number(&quality, "psnr")?,
        chamfer: number(&quality, "chamfer_relative")?,
    })
}
