//! Whole commands: seconds, memory, and how they grow.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use serde::Serialize;
use serde_json::Value;

use crate::dsdf;

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
    let mut child = Command::new(binary).args(arguments).args(["--json", "--quiet"]).stdout(Stdio::piped()).spawn()?;
    // The high-water mark of a process is gone with it, so it is read until then.
    let status = format!("/proc/{}/status", child.id());
    let mut peak = None;
    while child.try_wait()?.is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let high = text.lines().find_map(|l| l.strip_prefix("VmHWM:")?.split_whitespace().next()?.parse::<f64>().ok());
        peak = high.map(|kib| kib / 1024.0).or(peak);
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
            peak.into_iter().chain(best.1).fold(None, |m: Option<f64>, p| Some(m.map_or(p, |m| m.max(p)))),
        );
    }
    Ok(best)
}

/// The suite's disc at a size, seen as large as ever.
fn disc(size: u32) -> anyhow::Result<Value> {
    let mut scene = dsdf::scene("disc.constant")?;
    let old = scene["camera"]["width"].as_f64().context("a width")?;
    let factor = f64::from(size) / old;
    let focal = scene["camera"]["focal"].as_f64().context("a focal length")? * factor;
    let camera = &mut scene["camera"];
    camera["width"] = size.into();
    camera["height"] = size.into();
    camera["focal"] = focal.into();
    camera["principal"] = [f64::from(size) / 2.0; 2].to_vec().into();
    Ok(scene)
}

/// Measures whole commands and prints them.
pub(crate) fn measure(binary: &Path) -> anyhow::Result<Vec<Program>> {
    let folder = tempfile::tempdir()?;
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (scene, large, out) = (path("128.json"), path("1024.json"), path("out.npy"));
    std::fs::write(&scene, disc(128)?.to_string())?;
    std::fs::write(&large, disc(1024)?.to_string())?;
    let network = path("network.json");
    std::fs::write(&network, dsdf::scene("network.constant")?.to_string())?;
    let by = ["--wrt", "/sdf/radius"];
    let commands: [(&str, Vec<&str>); 4] = [
        ("image of a disc, 128 × 128, 16 samples", vec!["render", &scene, "--spp", "16"]),
        ("its derivative by the radius, 4 samples", [&["gradient", &scene, "--spp", "4"], &by[..]].concat()),
        ("the same, 1024 × 1024", [&["gradient", &large, "--spp", "4"], &by[..]].concat()),
        (
            "derivative of a network along a random direction, 16 × 16, 64 samples",
            vec!["gradient", &network, "--spp", "64", "--wrt", "/sdf/weights/0"],
        ),
    ];
    let mut programs = Vec::new();
    for (name, arguments) in commands {
        let (seconds, peak_mebibytes) = best(binary, &[&arguments[..], &["-o", &out]].concat())?;
        let memory = peak_mebibytes.map_or("?".to_owned(), |m| format!("{m:.0}"));
        println!("| {name} | {seconds:.4} | {memory} |");
        programs.push(Program { name: name.to_owned(), seconds, peak_mebibytes });
    }
    Ok(programs)
}

/// How the seconds of a derivative image grow with what it is asked for.
pub(crate) fn growth(binary: &Path) -> anyhow::Result<Vec<Growth>> {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("out.npy").to_string_lossy().into_owned();
    let seconds = |size: u32, flags: &[&str]| -> anyhow::Result<f64> {
        let scene = folder.path().join("scene.json");
        std::fs::write(&scene, disc(size)?.to_string())?;
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
        let values: Vec<f64> =
            values.iter().map(|v| if flag.is_empty() { f64::from(v * v) } else { f64::from(*v) }).collect();
        let exponent = slope(&values, &times);
        println!("| {with} | {exponent:.2} |");
        all.push(Growth { with, values, seconds: times, exponent });
    }
    Ok(all)
}

/// The least-squares slope of ln y over ln x.
fn slope(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len() as f64;
    let (x, y): (Vec<f64>, Vec<f64>) = (x.iter().map(|v| v.ln()).collect(), y.iter().map(|v| v.ln()).collect());
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
