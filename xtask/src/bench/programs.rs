//! Time and memory of whole commands.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use serde::Serialize;
use serde_json::Value;
use sweep::measure::dsdf;

use super::scenes::{disc, network, photographs};

/// Time and memory of a command.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct CommandCost {
    /// A description of the command.
    name: String,
    /// The least of several runs, without start-up and file access.
    seconds: f64,
    /// The largest resident set of all runs; unknown without `/proc`.
    peak_mebibytes: Option<f64>,
}

/// Runs of every command.
const TRIES: usize = 5;

/// Time between two reads of a process's memory.
const INTERVAL: std::time::Duration = std::time::Duration::from_millis(2);

/// Seconds of a command by its own report, and its largest resident set in MiB.
fn once(binary: &Path, arguments: &[&str]) -> anyhow::Result<(f64, Option<f64>)> {
    let mut child = Command::new(binary)
        .args(arguments)
        .args(["--json", "--quiet"])
        .stdout(Stdio::piped())
        .spawn()?;
    // The system forgets the high-water mark with the process: it is read until the end.
    let mut peak = None;
    while child.try_wait()?.is_none() {
        peak = dsdf::memory(child.id(), "VmHWM:").or(peak);
        std::thread::sleep(INTERVAL);
    }
    let output = child.wait_with_output()?;
    ensure!(output.status.success(), "dsdf {} failed", arguments.join(" "));
    let report: Value = serde_json::from_slice(&output.stdout)?;
    Ok((report["seconds"].as_f64().context("seconds in the report")?, peak))
}

/// The least seconds of several runs, and the largest of their resident sets in MiB.
pub(crate) fn best(binary: &Path, arguments: &[&str]) -> anyhow::Result<(f64, Option<f64>)> {
    let (mut least, mut largest) = (f64::INFINITY, None::<f64>);
    for _ in 0..TRIES {
        let (seconds, peak) = once(binary, arguments)?;
        least = least.min(seconds);
        largest = peak.map(|peak| largest.map_or(peak, |m| m.max(peak))).or(largest);
    }
    Ok((least, largest))
}

/// Seconds of one iteration of a fit at its defaults: the mean over a fit of 300 iterations.
fn iteration(binary: &Path, folder: &Path) -> anyhow::Result<f64> {
    let (data, run) = (photographs(binary, folder, 256)?, tempfile::tempdir_in(folder)?);
    let run = run.path().to_string_lossy().into_owned();
    let count = 300;
    let flags = ["--iterations", &count.to_string(), "--preview-every", "100000"];
    dsdf::run_json(binary, &[&["fit", &data, "-o", &run], &flags[..]].concat())?;
    let metrics = std::fs::read_to_string(Path::new(&run).join("metrics.jsonl"))?;
    let last: Value = serde_json::from_str(metrics.lines().last().context("metrics")?)?;
    Ok(last["seconds"].as_f64().context("seconds in the metrics")? / f64::from(count))
}

/// Measures all commands and prints them.
pub(crate) fn measure(binary: &Path) -> anyhow::Result<Vec<CommandCost>> {
    println!("\n| program | seconds | peak memory, MiB |\n|---|---|---|");
    let folder = tempfile::tempdir()?;
    let mut costs = Vec::new();
    for (name, arguments) in commands(binary, folder.path())? {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let (seconds, peak_mebibytes) = best(binary, &arguments)?;
        costs.push(CommandCost { name: name.to_owned(), seconds, peak_mebibytes });
    }
    let first = iteration(binary, folder.path())?;
    let seconds = first.min(iteration(binary, folder.path())?);
    let name = "an iteration of a fit".to_owned();
    costs.push(CommandCost { name, seconds, peak_mebibytes: None });
    for CommandCost { name, seconds, peak_mebibytes } in &costs {
        let memory = peak_mebibytes.map_or("?".to_owned(), |m| format!("{m:.0}"));
        println!("| {name} | {seconds:.4} | {memory} |");
    }
    Ok(costs)
}

/// Writes the scenes of the commands into a folder, and returns the commands with their names.
fn commands(binary: &Path, folder: &Path) -> anyhow::Result<[(&'static str, Vec<String>); 6]> {
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let (scene, large, target) = (path("128.json"), path("1024.json"), path("target.npy"));
    let (out, weights) = (path("out.npy"), path("out.safetensors"));
    std::fs::write(&scene, disc(128).to_string())?;
    std::fs::write(&large, disc(1024).to_string())?;
    let network = network(binary, folder, 128, [64, 3], &[])?;
    dsdf::run_json(binary, &["render", &scene, "-o", &target])?;
    let words = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect();
    let image = |scene: &str| words(&["render", scene, "--spp", "16", "-o", &out]);
    let derivative =
        |scene: &str| words(&["gradient", scene, "--spp", "4", "-o", &out, "--wrt", "/sdf/radius"]);
    let by_weights = |precision: &str| {
        let loss = ["gradient", &network, "--target", &target, "--spp", "4", "-o", &weights];
        words(&[&loss[..], &["--precision", precision]].concat())
    };
    Ok([
        ("image of a disc, 128 × 128, 16 samples", image(&scene)),
        ("its derivative by the radius, 4 samples", derivative(&scene)),
        ("the same, 1024 × 1024", derivative(&large)),
        ("image of a network of 3 × 64, 128 × 128, 16 samples", image(&network)),
        ("gradient of its loss by all weights, 4 samples, f32", by_weights("f32")),
        ("the same, f64", by_weights("f64")),
    ])
}
