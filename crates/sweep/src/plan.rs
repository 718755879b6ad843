//! What a sweep would do: its values judged by the program itself, its cells, its time.

use std::path::Path;
use std::process::{Command, Output};

use super::refusal::Refusal;
use super::results::finished;
use super::sweep::{Cell, Sweep, flag, text};
use super::{Bench, Work};

/// Options that a sweep has keys of its own for.
const OWN: [(&str, &str); 13] = [
    ("help", "an option of a fit"),
    ("version", "an option of a fit"),
    ("check", "an option of a fit"),
    ("end_with", "an option of a fit"),
    ("stop_after", "iterations = N beside title"),
    ("seed", "seeds = [...] beside title"),
    ("iterations", "iterations = N beside title"),
    ("time", "time = \"...\" beside title"),
    ("threads", "--jobs"),
    ("output", "-o"),
    ("resume", "nothing: sweeps go on by themselves"),
    ("json", "sweeps without it: it is set"),
    ("quiet", "sweeps without it: it is set"),
];

/// Asks the program that will run the cells whether it takes every value, and every combination.
pub(super) fn check(sweep: &Sweep, name: &str, binary: &Path) -> anyhow::Result<()> {
    let file = Path::new(name);
    check_binary(binary)?;
    let listed = sweep
        .parameters
        .keys()
        .flat_map(|key| sweep.values(key).into_iter().map(move |v| ("parameters", key, v)));
    let fixed = sweep.fixed.iter().map(|(key, value)| ("fixed", key, text(value)));
    for (table, key, value) in fixed.chain(listed) {
        let field = format!("{table}.{key}");
        if let Some((_, instead)) = OWN.iter().find(|(own, _)| own == key) {
            return Err(Refusal::new(file, field, key, instead).into());
        }
        if key == "gradient_precision" {
            if value != "f32" && value != "f64" {
                return Err(Refusal::new(file, field, value, "f32 or f64").into());
            }
            continue;
        }
        // That a switch is off is said by its absence.
        let asked = if value == "false" { "true".to_owned() } else { value.clone() };
        let flags = flag((key.clone(), asked));
        if let Some(said) = refused(binary, &flags)? {
            let unknown = said.contains("unexpected argument");
            let expected =
                said.rsplit_once("expected ").map(|(_, e)| e.to_owned()).filter(|_| !unknown);
            let (found, expected) = if unknown {
                (key.clone(), "an option of `dsdf fit`".to_owned())
            } else {
                (value, expected.unwrap_or(said))
            };
            return Err(Refusal::new(file, field, found, expected).into());
        }
    }
    // Values may be good alone and not together.
    let mut seen: Vec<Vec<String>> = Vec::new();
    for cell in sweep.cells() {
        let flags: Vec<String> =
            sweep.flags(&cell).into_iter().filter(|f| !f.starts_with("--gradient-")).collect();
        let place: Vec<String> =
            flags.iter().filter(|f| !f.starts_with("--seed=")).cloned().collect();
        if !seen.contains(&place) {
            if let Some(said) = refused(binary, &flags)? {
                return Err(Refusal::new(file, cell.name, said, "options that go together").into());
            }
            seen.push(place);
        }
    }
    Ok(())
}

/// Refuses what cannot run, or takes no options of a fit.
fn check_binary(binary: &Path) -> anyhow::Result<()> {
    let found = match refused(binary, &["--no-such-option".to_owned()]) {
        Ok(Some(said)) if said.contains("--no-such-option") => return Ok(()),
        Ok(None) => "a program that takes anything".to_owned(),
        Ok(Some(said)) if said.is_empty() => "a program that says nothing".to_owned(),
        Ok(Some(said)) => said,
        Err(error) => error.to_string(),
    };
    Err(Refusal::new(binary, "--binary", found, "a program like dsdf").into())
}

/// Refuses a package that the workspace does not have.
pub(super) fn check_package(sweep: &Sweep, name: &str) -> anyhow::Result<()> {
    let packages = measure::dsdf::packages()?;
    if !packages.contains(&sweep.package) {
        let expected = format!("one of {}", packages.join(", "));
        return Err(Refusal::new(Path::new(name), "package", &sweep.package, expected).into());
    }
    Ok(())
}

/// Refuses data that is not there, or that the program does not know.
pub(super) fn check_data(
    sweep: &Sweep,
    folder: &Path,
    name: &str,
    binary: &Path,
) -> anyhow::Result<()> {
    for data in &sweep.data {
        let field = |key: &str| format!("data.{}.{key}", data.name);
        let files = [
            ("scene", &data.scene, false),
            ("dataset", &data.dataset, true),
            ("mesh", &data.mesh, false),
        ];
        for (key, path, is_folder) in files {
            let Some(path) = path.as_ref().map(|path| folder.join(path)) else { continue };
            if !(if is_folder { path.is_dir() } else { path.is_file() }) {
                let expected = if is_folder { "a folder" } else { "a file" };
                return Err(
                    Refusal::new(Path::new(name), field(key), path.display(), expected).into()
                );
            }
        }
        let is_mesh = |path: &String| path.ends_with(".ply") || path.ends_with(".obj");
        if let Some(mesh) = data.mesh.as_ref().filter(|path| !is_mesh(path)) {
            return Err(
                Refusal::new(Path::new(name), field("mesh"), mesh, "a .ply or .obj file").into()
            );
        }
        if let Some(dataset) = &data.dataset {
            let output = Command::new(binary)
                .args(["inspect", "--json"])
                .arg(folder.join(dataset))
                .output()?;
            if !output.status.success() {
                return Err(Refusal::of(
                    Path::new(name),
                    field("dataset"),
                    &said(&output),
                    "a data set",
                )
                .into());
            }
        }
        if data.views == 0 || data.size == 0 {
            return Err(Refusal::new(
                Path::new(name),
                field("views"),
                "0",
                "1 or more, as for size",
            )
            .into());
        }
    }
    Ok(())
}

/// What the program says against options, if anything.
fn refused(binary: &Path, flags: &[String]) -> anyhow::Result<Option<String>> {
    let output =
        Command::new(binary).args(["fit", "--check", "-o", "unused"]).args(flags).output()?;
    Ok((!output.status.success()).then(|| said(&output)))
}

/// The message of a program that failed.
fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).trim().trim_start_matches("error: ").to_owned()
}

/// Iterations of a fit that is timed for the estimate, and how many cells are.
const PILOT: u64 = 30;
const PILOTS: usize = 4;

/// Prints the cells, and how long those take that are left.
pub(super) fn show(work: &Work, binary: &Path, cells: &[Cell], jobs: usize) -> anyhow::Result<()> {
    let (mut known, mut left) = (Vec::new(), Vec::new());
    for (number, cell) in cells.iter().enumerate() {
        let row = finished(&work.cell(cell));
        let state = row.as_ref().map_or("", |row| row.status.as_str());
        super::say(&format!("{number:>5} {} {state}\n", cell.name));
        match row {
            Some(row) => known.extend(row.numbers.get("seconds").copied()),
            None => left.push(cell),
        }
    }
    let each = if left.is_empty() {
        0.0
    } else if known.is_empty() {
        pilot(work, binary, &left)?
    } else {
        known.iter().sum::<f64>() / known.len() as f64
    };
    // Evaluation and gradients take about ten seconds beside the fit.
    let minutes = left.len() as f64 * (each + 10.0) / jobs as f64 / 60.0;
    super::say(&format!(
        "{} cells, {} to run: about {minutes:.0} minutes with {jobs} at a time ({each:.0} s a fit)\n",
        cells.len(),
        left.len()
    ));
    Ok(())
}

/// Seconds of a fit, by a few short ones.
fn pilot(work: &Work, binary: &Path, cells: &[&Cell]) -> anyhow::Result<f64> {
    if let Some(time) = &work.sweep.time {
        return Ok(humantime::parse_duration(time)?.as_secs_f64());
    }
    // A preset's own number is not known here: that of the default.
    let iterations = work.sweep.iterations.unwrap_or(6000);
    let folder = tempfile::tempdir()?;
    let trial = Work {
        sweep: work.sweep.clone(),
        folder: work.folder.clone(),
        output: folder.path().to_owned(),
    };
    let data = trial.photographs(binary)?;
    let cells_folder = folder.path().join("cells");
    let context =
        Bench { sweep: &trial.sweep, binary, data: &data, cells: cells_folder, threads: 1 };
    let step = cells.len().div_ceil(PILOTS).max(1);
    let some: Vec<&&Cell> = cells.iter().step_by(step).collect();
    let mut seconds = 0.0;
    for cell in &some {
        seconds += context.pilot(cell, PILOT)?;
    }
    Ok(seconds / some.len() as f64 / PILOT as f64 * iterations as f64)
}
