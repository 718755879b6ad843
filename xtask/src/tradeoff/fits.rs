//! Fits: quality over time, by network and by preset.

use std::fmt::Write;
use std::path::Path;

use anyhow::Context;
use serde_json::Value;

use measure::dsdf::{report, root};

/// A fit's flags under a name.
pub(super) struct Setting {
    pub(super) name: &'static str,
    pub(super) flags: &'static [&'static str],
}

/// Networks, each for the same time.
pub(super) const NETWORKS: [Setting; 5] = [
    Setting { name: "3 × 32", flags: &["--width", "32", "--time", "40s"] },
    Setting { name: "3 × 64", flags: &["--time", "40s"] },
    Setting { name: "3 × 128", flags: &["--width", "128", "--time", "40s"] },
    Setting { name: "2 × 64", flags: &["--layers", "2", "--time", "40s"] },
    Setting { name: "4 × 64", flags: &["--layers", "4", "--time", "40s"] },
];

/// The presets as they are.
pub(super) const PRESETS: [Setting; 3] = [
    Setting { name: "fast", flags: &["--preset", "fast"] },
    Setting { name: "balanced", flags: &["--preset", "balanced"] },
    Setting { name: "accurate", flags: &["--preset", "accurate"] },
];

/// How a fit went.
#[derive(Clone, Debug)]
pub(super) struct Fitted {
    pub(super) name: &'static str,
    pub(super) seconds: f64,
    pub(super) iterations: u64,
    pub(super) psnr: f64,
    /// Chamfer distance in bounding radii.
    pub(super) chamfer: f64,
}

/// Photographs of the demo's scene.
pub(super) fn photographs(binary: &Path, folder: &Path) -> anyhow::Result<String> {
    let data = folder.join("dataset").to_string_lossy().into_owned();
    let scene = root().join("crates/app/src/cli/demo_scene.json").to_string_lossy().into_owned();
    report(binary, &["synth", &scene, "-o", &data, "--views", "24", "--size", "128x128"])?;
    Ok(data)
}

/// Fits and evaluates.
pub(super) fn measure(
    binary: &Path,
    folder: &Path,
    data: &str,
    setting: &Setting,
    csv: &mut String,
) -> anyhow::Result<Fitted> {
    let run = tempfile::tempdir_in(folder)?;
    let run = run.path().to_string_lossy().into_owned();
    let fitted = report(binary, &[&["fit", data, "-o", &run], setting.flags].concat())?;
    let truth = Path::new(data).join("truth.ply").to_string_lossy().into_owned();
    let quality = report(binary, &["eval", &run, "--mesh", &truth])?;
    let number = |value: &Value, key: &'static str| value[key].as_f64().context(key);
    let fitted = Fitted {
        name: setting.name,
        seconds: number(&fitted, "seconds")?,
        iterations: fitted["iterations"].as_u64().context("iterations")?,
        psnr: number(&quality, "psnr")?,
        chamfer: number(&quality, "chamfer_relative")?,
    };
    let Fitted { name, seconds, iterations, psnr, chamfer } = &fitted;
    let _ = writeln!(csv, "{name},{seconds:.2},{iterations},{psnr:.2},{chamfer:.5}");
    Ok(fitted)
}
