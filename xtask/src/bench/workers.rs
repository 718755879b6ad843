//! The simulation of iterations on many threads.

use std::path::{Path, PathBuf};
use std::process::Stdio;

use anyhow::ensure;
use serde_json::{Value, json};
use sweep::measure::{cargo_command, dsdf, workspace_root};

/// The scene, as the sweep `detail` has it: a slab with ridges.
const SCENE: &str = "xtask/sweeps/scenes/ridges.json";

/// Iterations of the run, and those at which it is simulated: with a soft surface, and with a sharp
/// one and all levels of the grid.
const ITERATIONS: &str = "3000";
const AT: [(&str, &str); 2] = [("soft", "900"), ("sharp", "2400")];

/// Iterations that are simulated.
const SIMULATED: &str = "200";

/// Simulates iterations on `workers` threads, prints the result, and writes it to `output`.
pub(crate) fn run(workers: usize, output: Option<PathBuf>) -> anyhow::Result<()> {
    let path = output.unwrap_or_else(|| workspace_root().join("target/workers.json"));
    let both = [2, workers];
    let results = measure(&dsdf::build()?, if workers == 2 { &both[..1] } else { &both })?;
    super::write(&path, &results)?;
    eprintln!("{}", path.display());
    Ok(())
}

/// Simulates iterations with a soft and with a sharp surface on these numbers of threads, and prints
/// the results.
pub(crate) fn measure(binary: &Path, threads: &[usize]) -> anyhow::Result<Vec<Value>> {
    let folder = tempfile::tempdir()?;
    let [data, run] = ["data", "run"].map(|n| folder.path().join(n).to_string_lossy().into_owned());
    let scene = workspace_root().join(SCENE).to_string_lossy().into_owned();
    dsdf::run_json(binary, &["synth", &scene, "-o", &data, "--views", "24", "--size", "200x200"])?;
    println!(
        "A simulation: one thread computes all tasks, and their times are dealt to workers.\n"
    );
    println!("| surface | workers | ms on one | simulated ms | faster | efficiency |");
    println!("|---|---|---|---|---|---|");
    let mut results = Vec::new();
    for (surface, at) in AT {
        let begin = ["fit", &data, "-o", &run, "--iterations", ITERATIONS, "--seed", "1"];
        let again = ["fit", "-o", &run, "--resume"];
        let start: &[&str] = if results.is_empty() { &begin } else { &again };
        dsdf::run_json(binary, &[start, &["--masks", "ignore", "--stop-after", at]].concat())?;
        for workers in threads {
            let found = simulate(&run, *workers)?;
            let of = |key: &str| found[key].as_f64().unwrap_or(f64::NAN);
            let (ms, simulated) = (of("ms"), of("simulated_ms"));
            let (faster, efficiency) = (of("speed_up"), 100.0 * of("efficiency"));
            println!(
                "| {surface} | {workers} | {ms:.2} | {simulated:.2} | {faster:.1} | \
                 {efficiency:.0} % |"
            );
            results.push(json!({"surface": surface, "workers": workers, "result": found}));
        }
    }
    Ok(results)
}

/// Runs the bench `workers` of `fit` on a run.
fn simulate(run: &str, workers: usize) -> anyhow::Result<Value> {
    let arguments = ["bench", "--package", "dsdf-fit", "--bench", "workers", "--"];
    let output = cargo_command(&[&arguments[..], &[run, &workers.to_string(), SIMULATED]].concat())
        .stderr(Stdio::inherit())
        .output()?;
    ensure!(
        output.status.success(),
        "the bench workers of fit failed on {}",
        Path::new(run).display()
    );
    Ok(serde_json::from_slice(&output.stdout)?)
}
