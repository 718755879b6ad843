//! The metrics that a running fit writes: `metrics.jsonl`, one JSON object for each iteration.
//!
//! A sweep runs programs, and is built without a renderer. So it names the files of a run itself,
//! and does not depend on `fit` for its `RunFolder`.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use crate::report::results::CellResult;
use serde_json::Value;

/// Parts of a fit over which losses are averaged.
const WINDOWS: usize = 20;

/// Counts of field evaluations in a line, with the metrics that they become.
const EVALUATIONS: [(&str, &str); 4] = [
    ("value", "values"),
    ("gradient", "gradients"),
    ("hessian_vector", "hessian_vectors"),
    ("parameter", "parameters"),
];

/// Adds seconds, iterations, evaluations, losses and the loss curve of a fit to a result. A fit
/// without a whole line adds nothing.
pub(crate) fn add_fit_metrics(run: &Path, result: &mut CellResult) {
    let text = std::fs::read_to_string(run.join("metrics.jsonl")).unwrap_or_default();
    let lines: Vec<Value> =
        text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    let Some(last) = lines.last() else { return };
    let numbers = &mut result.numbers;
    numbers.extend(last["seconds"].as_f64().map(|s| ("seconds".to_owned(), s)));
    numbers.insert("iterations".to_owned(), lines.len() as f64);
    for (from, to) in EVALUATIONS {
        let total = lines.iter().filter_map(|line| line["evaluations"][from].as_f64()).sum();
        numbers.insert(to.to_owned(), total);
    }
    add_losses(&lines, result);
}

/// Adds the loss curve, the loss at the end and the lowest loss: means over a twentieth of the fit.
fn add_losses(lines: &[Value], result: &mut CellResult) {
    let window = lines.len().div_ceil(WINDOWS);
    let point = |part: &[Value]| (part[0]["iteration"].as_f64().unwrap_or(0.0), mean_loss(part));
    result.curve = lines.chunks(window).map(point).collect();
    // Losses of the coarser images at the start do not compare with those of full-sized images.
    let full: Vec<Value> = lines.iter().filter(|line| line["level"] == 0).cloned().collect();
    // Windows are counted from the end, so that the first holds the last iterations.
    let windows: Vec<f64> = full.rchunks_exact(window).map(mean_loss).collect();
    if let Some(end) = windows.first() {
        let best = windows.iter().copied().fold(f64::INFINITY, f64::min);
        result.numbers.insert("loss".to_owned(), *end);
        result.numbers.insert("best_loss".to_owned(), best);
    }
}

fn mean_loss(lines: &[Value]) -> f64 {
    lines.iter().filter_map(|l| l["loss"].as_f64()).sum::<f64>() / lines.len() as f64
}

/// The last whole line of a file of JSON lines; null if there is none.
pub(crate) fn last_line(path: &Path) -> Value {
    tail(path)
        .and_then(|text| text.lines().rev().find_map(|line| serde_json::from_str(line).ok()))
        .unwrap_or(Value::Null)
}

/// The last 4 KiB of a file, several lines of metrics.
fn tail(path: &Path) -> Option<String> {
    const TAIL: u64 = 4096;
    let mut file = std::fs::File::open(path).ok()?;
    let length = file.metadata().ok()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(TAIL))).ok()?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).ok()?;
    Some(String::from_utf8_lossy(&bytes).into_owned())
}
