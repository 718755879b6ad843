//! The gradient suite: the estimators and the cases of `tests/gradients/suite.toml`.

#![allow(clippy::print_stdout, reason = "the measured errors")]
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use serde::Deserialize;
use tests::{npy, program, program_json, root};

#[derive(Deserialize)]
struct Suite {
    estimator: Vec<SuiteEstimator>,
    case: Vec<Case>,
}

/// An estimator: its fields are described at the head of the file.
#[derive(Clone, Deserialize)]
struct SuiteEstimator {
    name: String,
    package: String,
    scenes: Option<Vec<String>>,
    error: Option<f64>,
}

impl SuiteEstimator {
    fn program(&self) -> PathBuf {
        program(&self.package)
    }
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

/// Runs of a case, each with its own seed.
const RUNS: u32 = 4;

/// Samples per pixel of a run.
const SPP: u32 = 256;

fn suite() -> PathBuf {
    root().join("tests/gradients")
}

/// The derivative images of a case, one for each parameter, and the field evaluations of all.
fn images(
    program: &Path,
    case: &Case,
    estimator: &str,
    spp: u32,
    seed: u32,
) -> (Vec<Vec<f32>>, u64) {
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
    let report = program_json(program, &arguments);
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

    /// Whether the tolerances hold.
    fn is_within(&self, bias: f64, error: f64) -> bool {
        self.bias <= bias + 3.0 * self.standard_error && self.error <= error
    }
}

/// Measures an estimator on a case and prints a row for each parameter. The error has a line for
/// each parameter out of tolerance.
fn check(estimator: &SuiteEstimator, case: &Case) -> Result<(), String> {
    let (program, name) = (estimator.program(), &estimator.name);
    let allowed = estimator.error.unwrap_or(case.error);
    let (references, _) = images(&program, case, "contour", case.reference, 0);
    let runs: Vec<_> = (0..RUNS).map(|seed| images(&program, case, name, SPP, seed)).collect();
    let evaluations = runs.iter().map(|(_, e)| e).sum::<u64>() / u64::from(RUNS);
    let mut failures = Vec::new();
    for (i, (wrt, reference)) in case.wrt.iter().zip(&references).enumerate() {
        let own: Vec<&[f32]> = runs.iter().map(|(images, _)| &images[i][..]).collect();
        let accuracy = Accuracy::new(&own, reference);
        let Accuracy { bias, standard_error, error, variance, .. } = accuracy;
        println!(
            "| {name} | {} | {wrt} | {bias:.4} ± {standard_error:.4} | {error:.4} \
             | {variance:.4} | {evaluations} |",
            case.scene
        );
        if !accuracy.is_within(case.bias, allowed) {
            let file = format!("{name}.{}{}", case.scene, wrt.replace('/', "_"));
            let picture = leave_pictures(&file, reference, &accuracy.mean);
            failures.push(format!(
                "{name}, {} {wrt}: bias {bias:.4} (allowed {} + 3 x {standard_error:.4}), error \
                 {error:.4} (allowed {allowed}); reference, mean and difference: {}",
                case.scene,
                case.bias,
                picture.display()
            ));
        }
    }
    if failures.is_empty() { Ok(()) } else { Err(failures.join("\n")) }
}

/// Checks the estimators of the suite that `wanted` accepts, each on its scenes.
fn check_estimators(wanted: impl Fn(&SuiteEstimator) -> bool) {
    let text = std::fs::read_to_string(suite().join("suite.toml")).unwrap();
    let suite: Suite = toml::from_str(&text).unwrap();
    println!(
        "| estimator | scene | by | bias ± standard error | error at {SPP} spp \
         | variance a sample | field evaluations |"
    );
    let mut work: Vec<(&SuiteEstimator, &Case)> = Vec::new();
    for estimator in suite.estimator.iter().filter(|e| wanted(e)) {
        let has = |case: &&Case| {
            estimator.scenes.as_ref().is_none_or(|scenes| scenes.contains(&case.scene))
        };
        work.extend(suite.case.iter().filter(has).map(|case| (estimator, case)));
    }
    assert!(!work.is_empty(), "no estimator and no case");
    // A small film does not occupy two threads: two cases run at a time, with one thread each.
    let left = Mutex::new(work.into_iter());
    let failures_of = || -> Vec<String> {
        let next = || left.lock().unwrap().next();
        std::iter::from_fn(next)
            .filter_map(|(estimator, case)| check(estimator, case).err())
            .collect()
    };
    let failures = std::thread::scope(|scope| {
        let others = scope.spawn(failures_of);
        [failures_of(), others.join().unwrap()].concat()
    });
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

#[test]
fn refined_is_unbiased_on_every_case() {
    check_estimators(|estimator| estimator.package == "dsdf");
}

#[test]
fn crofton_and_other_estimators_of_extensions_are_unbiased_on_their_cases() {
    check_estimators(|estimator| estimator.package != "dsdf");
}
