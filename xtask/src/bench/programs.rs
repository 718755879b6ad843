//! Whole commands: seconds, memory, and how they grow.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use serde::Serialize;
use serde_json::{Value, json};

use measure::dsdf;

/// A command, measured.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Program {
    name: String,
    /// Without start-up and file access: the best of a few.
    seconds: f64,
    /// The largest resident set.
    peak_mebibytes: Option<f64>,
}

/// The power with which seconds grow.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Growth {
    with: &'static str,
    values: Vec<f64>,
    seconds: Vec<f64>,
    /// The slope of the logarithms, by least squares.
    exponent: f64,
}

const TRIES: usize = 5;

/// Runs the binary under its own memory count; the report's seconds, and the largest resident set.
fn once(binary: &Path, arguments: &[&str]) -> anyhow::Result<(f64, Option<f64>)> {
    let mut child = Command::new(binary)
        .args(arguments)
        .args(["--json", "--quiet"])
        .stdout(Stdio::piped())
        .spawn()?;
    // The high-water mark of a process is gone with it, so it is read until then.
    let mut peak = None;
    while child.try_wait()?.is_none() {
        peak = dsdf::memory(child.id(), "VmHWM:").or(peak);
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let output = child.wait_with_output()?;
    ensure!(output.status.success(), "dsdf {} failed", arguments.join(" "));
    let report: Value = serde_json::from_slice(&output.stdout)?;
    Ok((report["seconds"].as_f64().context("seconds in the report")?, peak))
}

fn best(binary: &Path, arguments: &[&str]) -> anyhow::Result<(f64, Option<f64>)> {
    let mut best = (f64::INFINITY, None);
    for _ in 0..TRIES {
        let (seconds, peak) = once(binary, arguments)?;
        best = (
            best.0.min(seconds),
            peak.into_iter()
                .chain(best.1)
                .fold(None, |m: Option<f64>, p| Some(m.map_or(p, |m| m.max(p)))),
        );
    }
    Ok(best)
}

/// A ball of constant radiance, seen as large at every size.
fn disc(size: u32) -> Value {
    json!({
        "camera": {"width": size, "height": size, "focal": 2 * size, "principal": [size / 2, size / 2],
                   "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0]},
        "sdf": {"type": "sphere", "center": [0.05, 0.03, 0.0], "radius": 0.7},
        "appearance": {"type": "constant", "radiance": [1, 1, 1]},
        "background": [0, 0, 0]
    })
}

/// Photographs of a lit ball, taken once: a data set as small as can be fitted.
fn photographs(binary: &Path, folder: &Path, size: u32) -> anyhow::Result<String> {
    let text = |path: &Path| path.to_string_lossy().into_owned();
    let (scene, data) = (
        text(&folder.join("photographed.json")),
        text(&folder.join(format!("photographs.{size}"))),
    );
    std::fs::write(&scene, dsdf::scene("off-axis.lambert")?.to_string())?;
    if !Path::new(&data).exists() {
        let size = format!("{size}x{size}");
        dsdf::report(binary, &["synth", &scene, "-o", &data, "--views", "12", "--size", &size])?;
    }
    Ok(data)
}

/// A fresh network's sphere of half the bounding radius, as the disc is seen.
fn network(
    binary: &Path,
    folder: &Path,
    pixels: u32,
    width: u32,
    layers: u32,
) -> anyhow::Result<String> {
    let data = photographs(binary, folder, 32)?;
    let run = folder.join(format!("run.{width}.{layers}"));
    let run_name = run.to_string_lossy().into_owned();
    let (width_text, layers_text) = (width.to_string(), layers.to_string());
    let shape = ["--width", &width_text, "--layers", &layers_text, "--iterations", "1"];
    dsdf::report(binary, &[&["fit", &data, "-o", &run_name], &shape[..]].concat())?;
    let mut scene = disc(pixels);
    scene["sdf"] = json!({"type": "neural", "weights": run.join("model.safetensors")});
    let path = folder.join(format!("network.{width}.{layers}.json"));
    std::fs::write(&path, scene.to_string())?;
    Ok(path.to_string_lossy().into_owned())
}

/// Seconds of one iteration of a fit at its defaults: the mean over a short schedule.
fn iteration(binary: &Path, folder: &Path) -> anyhow::Result<f64> {
    let (data, run) = (photographs(binary, folder, 256)?, tempfile::tempdir_in(folder)?);
    let run = run.path().to_string_lossy().into_owned();
    let count = 300;
    let flags = ["--iterations", &count.to_string(), "--preview-every", "100000"];
    dsdf::report(binary, &[&["fit", &data, "-o", &run], &flags[..]].concat())?;
    let metrics = std::fs::read_to_string(Path::new(&run).join("metrics.jsonl"))?;
    let last: Value = serde_json::from_str(metrics.lines().last().context("metrics")?)?;
    Ok(last["seconds"].as_f64().context("seconds in the metrics")? / f64::from(count))
}

/// Measures whole commands and prints them.
pub(crate) fn measure(binary: &Path) -> anyhow::Result<Vec<Program>> {
    let folder = tempfile::tempdir()?;
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (scene, large, out, weights) =
        (path("128.json"), path("1024.json"), path("out.npy"), path("out.safetensors"));
    std::fs::write(&scene, disc(128).to_string())?;
    std::fs::write(&large, disc(1024).to_string())?;
    let (network, by) = (network(binary, folder.path(), 128, 64, 3)?, ["--wrt", "/sdf/radius"]);
    let target = path("target.npy");
    dsdf::report(binary, &["render", &scene, "-o", &target])?;
    let all =
        ["gradient", &network, "--target", &target, "--spp", "4", "-o", &weights, "--precision"];
    let commands: [(&str, Vec<&str>); 6] = [
        (
            "image of a disc, 128 × 128, 16 samples",
            vec!["render", &scene, "--spp", "16", "-o", &out],
        ),
        (
            "its derivative by the radius, 4 samples",
            [&["gradient", &scene, "--spp", "4", "-o", &out], &by[..]].concat(),
        ),
        (
            "the same, 1024 × 1024",
            [&["gradient", &large, "--spp", "4", "-o", &out], &by[..]].concat(),
        ),
        (
            "image of a network of 3 × 64, 128 × 128, 16 samples",
            vec!["render", &network, "--spp", "16", "-o", &out],
        ),
        ("gradient of its loss by all weights, 4 samples, f32", [&all[..], &["f32"]].concat()),
        ("the same, f64", [&all[..], &["f64"]].concat()),
    ];
    let mut programs = Vec::new();
    for (name, arguments) in commands {
        let (seconds, peak_mebibytes) = best(binary, &arguments)?;
        programs.push(Program { name: name.to_owned(), seconds, peak_mebibytes });
    }
    let seconds = (0..2)
        .map(|_| iteration(binary, folder.path()))
        .try_fold(f64::INFINITY, |m, s| s.map(|s| m.min(s)))?;
    programs.push(Program {
        name: "an iteration of a fit".to_owned(),
        seconds,
        peak_mebibytes: None,
    });
    for Program { name, seconds, peak_mebibytes } in &programs {
        let memory = peak_mebibytes.map_or("?".to_owned(), |m| format!("{m:.0}"));
        println!("| {name} | {seconds:.4} | {memory} |");
    }
    Ok(programs)
}

/// How wrong the measured derivative image is, relative L2.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Accuracy {
    /// Of the mean over infinitely many seeds, estimated from those taken.
    pub(crate) bias: f64,
    /// What noise alone makes of the mean over those taken.
    pub(crate) noise: f64,
    /// Of one run.
    pub(crate) rmse: f64,
}

const SEEDS: u32 = 64;

/// The accuracy of the disc's derivative at 4 samples, against contours.
pub(crate) fn accuracy(binary: &Path) -> anyhow::Result<Accuracy> {
    let (scene, wrt) = (disc(128), ["/sdf/radius".to_owned()]);
    let reference =
        dsdf::gradient(binary, &scene, &wrt, &["--estimator", "contour", "--spp", "1024"])?
            .images
            .remove(0);
    let mut images = Vec::new();
    for seed in 0..SEEDS {
        let flags = ["--spp", "4", "--seed", &seed.to_string()];
        images.push(dsdf::gradient(binary, &scene, &wrt, &flags)?.images.remove(0));
    }
    let spread = dsdf::Spread::of(&images.iter().collect::<Vec<_>>(), &reference);
    let relative = |square: f64| square.sqrt() / reference.norm();
    Ok(Accuracy {
        bias: relative(spread.bias.max(0.0)),
        noise: relative(spread.noise),
        rmse: relative(spread.run),
    })
}

/// How the seconds of a derivative image grow with what it is asked for.
pub(crate) fn growth(binary: &Path) -> anyhow::Result<Vec<Growth>> {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("out.npy").to_string_lossy().into_owned();
    let seconds = |size: u32, flags: &[&str]| -> anyhow::Result<f64> {
        let scene = folder.path().join("scene.json");
        std::fs::write(&scene, disc(size).to_string())?;
        let scene = scene.to_string_lossy().into_owned();
        let arguments = [&["gradient", &scene, "--wrt", "/sdf/radius", "-o", &out], flags].concat();
        best(binary, &arguments).map(|(seconds, _)| seconds)
    };
    let series: [(&'static str, &[u32], &str); 4] = [
        ("pixels", &[64, 128, 256, 512], ""),
        ("samples a pixel", &[16, 64, 256, 1024], "--spp"),
        ("N, points along a ray (paper)", &[22, 44, 88, 176], "--steps"),
        ("k, points with a weight (paper)", &[3, 6, 12, 22], "--top-k"),
    ];
    let mut all = Vec::new();
    for (with, values, flag) in series {
        let mut times = Vec::new();
        for value in values {
            let text = value.to_string();
            times.push(match flag {
                "" => seconds(*value, &["--spp", "16"])?,
                "--spp" => seconds(64, &["--spp", &text])?,
                _ => seconds(64, &["--spp", "16", "--estimator", "paper", flag, &text])?,
            });
        }
        let values = values
            .iter()
            .map(|v| if flag.is_empty() { f64::from(v * v) } else { f64::from(*v) })
            .collect();
        all.push(Growth::new(with, values, times));
    }
    let shapes: [(&'static str, &[[u32; 2]], usize); 2] = [
        ("width of a network of 3 layers", &[[32, 3], [64, 3], [128, 3], [256, 3]], 0),
        ("hidden layers of 64", &[[64, 2], [64, 4], [64, 8]], 1),
    ];
    for (with, shapes, which) in shapes {
        let mut times = Vec::new();
        for [width, layers] in shapes {
            let scene = network(binary, folder.path(), 32, *width, *layers)?;
            let flags = ["--wrt", "/sdf/weights/0", "--spp", "16", "--precision", "f32"];
            times.push(best(binary, &[&["gradient", &scene, "-o", &out], &flags[..]].concat())?.0);
        }
        all.push(Growth::new(with, shapes.iter().map(|s| f64::from(s[which])).collect(), times));
    }
    Ok(all)
}

impl Growth {
    fn new(with: &'static str, values: Vec<f64>, seconds: Vec<f64>) -> Self {
        let exponent = slope(&values, &seconds);
        println!("| {with} | {exponent:.2} |");
        Growth { with, values, seconds, exponent }
    }
}

/// The least-squares slope of ln y over ln x.
fn slope(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len() as f64;
    let (x, y): (Vec<f64>, Vec<f64>) =
        (x.iter().map(|v| v.ln()).collect(), y.iter().map(|v| v.ln()).collect());
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let covariance: f64 = x.iter().zip(&y).map(|(x, y)| (x - mx) * (y - my)).sum();
    covariance / x.iter().map(|x| (x - mx) * (x - mx)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_found() {
        let x = [1.0, 2.0, 5.0, 9.0];
        assert!((slope(&x, &x.map(|x: f64| 3.0 * x.powf(1.3))) - 1.3).abs() < 1e-12);
    }
}
