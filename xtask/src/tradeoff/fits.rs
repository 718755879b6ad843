//! Fits with different networks and presets: time and quality.

use std::fmt::Write;
use std::path::Path;

use anyhow::Context;
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
#[derive(Clone, Debug)]
pub(super) struct FitOutcome {
    /// Of the setting.
    pub(super) name: &'static str,
    /// Wall time of the fit, in seconds.
    pub(super) seconds: f64,
    /// Iterations of the fit.
    pub(super) iterations: u64,
    /// Of held-out views, in dB.
    pub(super) psnr: f64,
    /// Chamfer distance in bounding radii.
    pub(super) chamfer: f64,
}

/// Renders 24 views of the demo's scene as a data set, and returns its folder.
pub(super) fn photographs(binary: &Path, folder: &Path) -> anyhow::Result<String> {
    let data = folder.join("dataset").to_string_lossy().into_owned();
    let scene =
        workspace_root().join("crates/app/src/cli/demo_scene.json").to_string_lossy().into_owned();
    run_json(binary, &["synth", &scene, "-o", &data, "--views", "24", "--size", "128x128"])?;
    Ok(data)
}

/// Fits a data set, evaluates the fit, and adds a row to `csv`.
pub(super) fn measure(
    binary: &Path,
    folder: &Path,
    data: &str,
    setting: &FitSetting,
    csv: &mut String,
) -> anyhow::Result<FitOutcome> {
    let run = tempfile::tempdir_in(folder)?;
    let run = run.path().to_string_lossy().into_owned();
    let fit = run_json(binary, &[&["fit", data, "-o", &run], setting.flags].concat())?;
    let truth = Path::new(data).join("truth.ply").to_string_lossy().into_owned();
    let quality = run_json(binary, &["eval", &run, "--mesh", &truth])?;
    let number = |value: &Value, key: &'static str| value[key].as_f64().context(key);
    let outcome = FitOutcome {
        name: setting.name,
        seconds: number(&fit, "seconds")?,
        iterations: fit["iterations"].as_u64().context("iterations")?,
        psnr: number(&quality, "psnr")?,
        chamfer: number(&quality, "chamfer_relative")?,
    };
    let FitOutcome { name, seconds, iterations, psnr, chamfer } = &outcome;
    let _ = writeln!(csv, "{name},{seconds:.2},{iterations},{psnr:.2},{chamfer:.5}");
    Ok(outcome)
}
