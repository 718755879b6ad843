//! Running the binary, and what it leaves.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};
use serde::Deserialize;
use serde_json::Value;

/// The workspace's root folder.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).map(Path::to_owned).unwrap_or_default()
}

/// Builds the binary for measurements.
pub fn build() -> anyhow::Result<PathBuf> {
    build_package("app", "release")
}

/// Builds the binary of a package: `dsdf` of the application, or of one that extends it, by its own
/// name; with a profile of the workspace.
pub fn build_package(package: &str, profile: &str) -> anyhow::Result<PathBuf> {
    let name = if package == "app" { "dsdf" } else { package };
    crate::cargo(&["build", "--profile", profile, "--package", package, "--bin", name], &[])?;
    let target =
        root().join(std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()));
    Ok(target.join(profile).join(format!("{name}{}", std::env::consts::EXE_SUFFIX)))
}

/// The packages of the workspace.
pub fn packages() -> anyhow::Result<Vec<String>> {
    let output =
        crate::cargo_command(&["metadata", "--no-deps", "--format-version", "1"]).output()?;
    ensure!(
        output.status.success(),
        "cargo metadata: {}",
        String::from_utf8_lossy(&output.stderr).trim()
    );
    let metadata: Value = serde_json::from_slice(&output.stdout)?;
    let packages = metadata["packages"].as_array().context("packages")?;
    Ok(packages.iter().filter_map(|package| package["name"].as_str().map(str::to_owned)).collect())
}

/// A case of the gradient suite.
#[derive(Clone, Debug, Deserialize)]
pub struct Case {
    /// The scene's name.
    pub scene: String,
    /// What it is differentiated by.
    pub wrt: Vec<String>,
}

/// The gradient suite.
pub fn suite() -> anyhow::Result<Vec<Case>> {
    #[derive(Deserialize)]
    struct Suite {
        case: Vec<Case>,
    }
    let path = root().join("tests/gradients/suite.toml");
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    Ok(toml::from_str::<Suite>(&text)?.case)
}

/// A scene of the gradient suite.
pub fn scene(name: &str) -> anyhow::Result<Value> {
    let path = root().join("tests/gradients").join(format!("{name}.json"));
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    let mut scene: Value = serde_json::from_str(&text)?;
    // A scene is run from another folder.
    if let Some(weights) = scene.pointer_mut("/sdf/weights")
        && let Some(name) = weights.as_str()
    {
        let absolute = root().join("tests/gradients").join(name);
        *weights = absolute.to_string_lossy().into_owned().into();
    }
    Ok(scene)
}

/// An image of three channels, row-major.
#[derive(Clone, Debug)]
pub struct Image {
    /// Width in pixels.
    pub width: usize,
    /// The pixels, row-major.
    pub pixels: Vec<[f64; 3]>,
}

impl Image {
    /// The mean of images of one size.
    fn mean(images: &[&Image]) -> Image {
        let share = 1.0 / images.len() as f64;
        let pixel = |p: usize| {
            std::array::from_fn(|c| images.iter().map(|i| i.pixels[p][c]).sum::<f64>() * share)
        };
        Image { width: images[0].width, pixels: (0..images[0].pixels.len()).map(pixel).collect() }
    }

    /// The L2 norm over pixels and channels.
    pub fn norm(&self) -> f64 {
        self.pixels.iter().flatten().map(|v| v * v).sum::<f64>().sqrt()
    }

    /// The L2 distance to an image of the same size.
    pub fn distance(&self, other: &Image) -> f64 {
        let pairs = self.pixels.iter().flatten().zip(other.pixels.iter().flatten());
        pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
    }
}

/// How far runs with different seeds are from a reference: squared L2 distances.
pub struct Spread {
    /// Of a run, the mean.
    pub run: f64,
    /// Of the mean over infinitely many runs, estimated; below 0 where noise explains more than
    /// there is.
    pub bias: f64,
    /// What noise alone makes of the mean over the runs taken.
    pub noise: f64,
}

impl Spread {
    /// Of two or more runs.
    pub fn of(runs: &[&Image], reference: &Image) -> Self {
        let (n, mean) = (runs.len() as f64, Image::mean(runs));
        let square = |to: &Image| runs.iter().map(|run| run.distance(to).powi(2)).sum::<f64>() / n;
        // The mean's own noise is in its distance.
        let noise = square(&mean) / (n - 1.0);
        Spread { run: square(reference), bias: mean.distance(reference).powi(2) - noise, noise }
    }
}

/// Runs a command of the binary; its report.
pub fn report(binary: &Path, arguments: &[&str]) -> anyhow::Result<Value> {
    let output = Command::new(binary).args(arguments).args(["--json", "--quiet"]).output()?;
    if !output.status.success() {
        bail!("dsdf {}: {}", arguments.join(" "), String::from_utf8_lossy(&output.stderr));
    }
    Ok(serde_json::from_slice(&output.stdout)?)
}

/// What the system says of a running process's memory under `key`, in MiB, where it says anything.
pub fn memory(process: u32, key: &str) -> Option<f64> {
    let text = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? / 1024.0)
}

/// A way to run commands of the binary.
pub trait Run {
    /// The report of a command.
    fn report(&self, arguments: &[&str]) -> anyhow::Result<Value>;
}

impl Run for Path {
    fn report(&self, arguments: &[&str]) -> anyhow::Result<Value> {
        report(self, arguments)
    }
}

/// Derivative images, one for each thing the scene was differentiated by, with the seconds and
/// field evaluations they took.
pub struct Derivatives {
    /// One image for each pointer.
    pub images: Vec<Image>,
    /// Wall time of the computation.
    pub seconds: f64,
    /// Field evaluations: values, gradients and Hessian–vector products.
    pub evaluations: u64,
}

/// Runs `dsdf gradient` on a scene.
pub fn gradient(
    program: &(impl Run + ?Sized),
    scene: &Value,
    wrt: &[String],
    flags: &[&str],
) -> anyhow::Result<Derivatives> {
    let folder = tempfile::tempdir()?;
    let (file, out) = (folder.path().join("scene.json"), folder.path().join("g.npy"));
    std::fs::write(&file, scene.to_string())?;
    let (file_name, out_name) = (file.to_string_lossy(), out.to_string_lossy());
    let by = wrt.iter().flat_map(|wrt| ["--wrt", wrt]);
    let report = program.report(
        &["gradient", &file_name, "-o", &out_name]
            .into_iter()
            .chain(by)
            .chain(flags.iter().copied())
            .collect::<Vec<_>>(),
    )?;
    let images = wrt.iter().map(|one| {
        let suffix = one.trim_start_matches('/').replace('/', "_");
        read_npy(&if wrt.len() == 1 {
            out.clone()
        } else {
            folder.path().join(format!("g.{suffix}.npy"))
        })
    });
    let kinds = ["value", "gradient", "hessian_vector"];
    Ok(Derivatives {
        images: images.collect::<anyhow::Result<_>>()?,
        seconds: report["seconds"].as_f64().context("seconds in the report")?,
        evaluations: kinds.iter().filter_map(|kind| report["evaluations"][kind].as_u64()).sum(),
    })
}

/// A float32 .npy file of H × W × 3, as dsdf writes it.
fn read_npy(path: &Path) -> anyhow::Result<Image> {
    let bytes = std::fs::read(path).with_context(|| path.display().to_string())?;
    ensure!(bytes.len() > 10, "{} is cut short", path.display());
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8_lossy(&bytes[10..start]).into_owned();
    let shape = header.split('(').nth(1).and_then(|s| s.split(')').next()).context("a shape")?;
    let sizes: Vec<usize> = shape.split(',').filter_map(|s| s.trim().parse().ok()).collect();
    let numbers: Vec<f64> = bytes[start..]
        .chunks_exact(4)
        .map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])))
        .collect();
    let width = *sizes.get(1).context("a width")?;
    Ok(Image { width, pixels: numbers.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect() })
}
