//! The gradient suite: every case of `tests/gradients/suite.toml` with the estimator `refined`.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::path::{Path, PathBuf};

use serde::Deserialize;
use tests::{dsdf_json, npy, root};

#[derive(Deserialize)]
struct Suite {
    case: Vec<Case>,
}

/// A case: its fields are described at the head of the file.
#[derive(Deserialize)]
struct Case {
    scene: String,
    wrt: Vec<String>,
    #[serde(default = "bias")]
    bias: f64,
    #[serde(default = "error")]
    error: f64,
    #[serde(default = "reference")]
    reference: u32,
}

fn bias() -> f64 {
    0.01
}

fn error() -> f64 {
    0.02
}

fn reference() -> u32 {
    1024
}

/// Runs of every case, each with its own seed.
const SEEDS: u32 = 16;

/// Samples per pixel of a run.
const SPP: u32 = 256;

fn suite() -> PathBuf {
    root().join("tests/gradients")
}

/// The derivative images of a case, one for each parameter, and the field evaluations of all.
fn images(case: &Case, estimator: &str, spp: u32, seed: u32) -> (Vec<Vec<f32>>, u64) {
    let folder = tempfile::tempdir().unwrap();
    let scene = suite().join(format!("{}.json", case.scene)).to_string_lossy().into_owned();
    let out = folder.path().join("g.npy").to_string_lossy().into_owned();
    let (spp, seed) = (spp.to_string(), seed.to_string());
    let mut arguments = vec![
        "gradient",
        &scene,
        "-o",
        &out,
        "--estimator",
        estimator,
        "--spp",
        &spp,
        "--seed",
        &seed,
        "--threads",
        "1",
    ];
    case.wrt.iter().for_each(|wrt| arguments.extend(["--wrt", wrt]));
    let report = dsdf_json(&arguments);
    let kinds = ["value", "gradient", "hessian_vector"];
    let evaluations = kinds.iter().map(|kind| report["evaluations"][kind].as_u64().unwrap()).sum();
    let name = |wrt: &String| {
        folder.path().join(format!("g.{}.npy", wrt.trim_start_matches('/').replace('/', "_")))
    };
    (case.wrt.iter().map(|wrt| npy(&name(wrt))).collect(), evaluations)
}

/// The L2 distance.
fn distance(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
}

/// The L2 norm.
fn norm(a: &[f32]) -> f64 {
    a.iter().map(|a| f64::from(*a).powi(2)).sum::<f64>().sqrt()
}

/// Writes a picture of reference, mean and difference side by side: red above zero, blue below.
/// Returns its path.
fn leave_pictures(name: &str, reference: &[f32], actual: &[f32]) -> PathBuf {
    let side = ((reference.len() / 3) as f64).sqrt() as u32;
    let largest = reference.iter().fold(1e-9f32, |m, v| m.max(v.abs()));
    let mut picture = image::RgbImage::new(3 * side, side);
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let at = (3 * (y * side + x % side)) as usize;
        let value = match x / side {
            0 => reference[at],
            1 => actual[at],
            _ => actual[at] - reference[at],
        } / largest;
        let fade = (255.0 * (1.0 - value.abs().min(1.0))) as u8;
        pixel.0 = if value > 0.0 { [255, fade, fade] } else { [fade, fade, 255] };
    }
    let path = root().join("target/gradients").join(format!("{name}.png"));
    std::fs::create_dir_all(path.parent().unwrap_or(Path::new("."))).unwrap();
    picture.save(&path).unwrap();
    path
}

/// The numbers of one derivative image, over all runs.
struct Accuracy {
    /// The mean over the runs.
    mean: Vec<f32>,
    /// The relative L2 distance of the mean to the reference.
    bias: f64,
    /// The standard error of the mean, in the same unit.
    standard_error: f64,
    /// The relative L2 error of one run, root mean square.
    error: f64,
    /// The relative variance of one sample per pixel.
    variance: f64,
}

impl Accuracy {
    fn new(runs: &[&[f32]], reference: &[f32]) -> Self {
        let (n, scale) = (runs.len() as f64, norm(reference));
        let mean = |p: usize| runs.iter().map(|run| f64::from(run[p])).sum::<f64>() / n;
        let mean: Vec<f32> = (0..reference.len()).map(|p| mean(p) as f32).collect();
        let squares = |to: &[f32]| runs.iter().map(|run| distance(run, to).powi(2)).sum::<f64>();
        let spread = squares(&mean) / (n - 1.0);
        Accuracy {
            bias: distance(&mean, reference) / scale,
            standard_error: (spread / n).sqrt() / scale,
            error: (squares(reference) / n).sqrt() / scale,
            variance: spread * f64::from(SPP) / (scale * scale),
            mean,
        }
    }

    /// Whether the case's tolerances hold.
    fn is_within(&self, case: &Case) -> bool {
        self.bias <= case.bias + 3.0 * self.standard_error && self.error <= case.error
    }
}

/// Measures a case and prints a row for each parameter. The error has a line for each parameter
/// out of tolerance.
fn check(case: &Case) -> Result<(), String> {
    let (references, _) = images(case, "contour", case.reference, 0);
    let runs: Vec<_> = (0..SEEDS).map(|seed| images(case, "refined", SPP, seed)).collect();
    let evaluations = runs.iter().map(|(_, e)| e).sum::<u64>() / u64::from(SEEDS);
    let mut failures = Vec::new();
    for (i, (wrt, reference)) in case.wrt.iter().zip(&references).enumerate() {
        let own: Vec<&[f32]> = runs.iter().map(|(images, _)| &images[i][..]).collect();
        let accuracy = Accuracy::new(&own, reference);
        let Accuracy { bias, standard_error, error, variance, .. } = accuracy;
        println!(
            "| {} | {wrt} | {bias:.4} ± {standard_error:.4} | {error:.4} | {variance:.4} \
             | {evaluations} |",
            case.scene
        );
        if !accuracy.is_within(case) {
            let name = format!("{}{}", case.scene, wrt.replace('/', "_"));
            let picture = leave_pictures(&name, reference, &accuracy.mean);
            failures.push(format!(
                "{} {wrt}: bias {bias:.4} (allowed {} + 3 x {standard_error:.4}), error \
                 {error:.4} (allowed {}); reference, mean and difference: {}",
                case.scene,
                case.bias,
                case.error,
                picture.display()
            ));
        }
    }
    if failures.is_empty() { Ok(()) } else { Err(failures.join("\n")) }
}

#[test]
fn refined_is_unbiased_on_every_case() {
    let text = std::fs::read_to_string(suite().join("suite.toml")).unwrap();
    let suite: Suite = toml::from_str(&text).unwrap();
    println!(
        "| scene | by | bias ± standard error | error at {SPP} spp | variance a sample \
         | field evaluations |"
    );
    // A small film does not occupy two threads: two cases run at a time, with one thread each.
    let (mine, others): (Vec<_>, Vec<_>) =
        suite.case.iter().enumerate().partition(|(i, _)| i % 2 == 0);
    let failures_of = |cases: Vec<(usize, &Case)>| -> Vec<String> {
        cases.into_iter().filter_map(|(_, case)| check(case).err()).collect()
    };
    let failures = std::thread::scope(|scope| {
        let others = scope.spawn(|| failures_of(others));
        [failures_of(mine), others.join().unwrap()].concat()
    });
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}
