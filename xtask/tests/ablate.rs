//! Sweeps as a user runs them: small ones, uninterrupted, killed, in shards, and with wrong input.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use tests::{binary, root};

/// The command `ablate` with these arguments, in the workspace's root.
fn ablate(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    command.arg("ablate").args(arguments).arg("--binary").arg(binary()).current_dir(root());
    command
}

/// Runs `ablate` and checks its success.
fn run(arguments: &[&str]) -> Output {
    let output = ablate(arguments).output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "ablate {arguments:?}: {message}");
    output
}

/// Runs `ablate` and checks that it refuses its input: exit status 2, and one line, which is
/// returned.
fn refusal(arguments: &[&str]) -> String {
    let output = ablate(arguments).output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert_eq!(message.lines().count(), 1, "{arguments:?}: {message}");
    message
}

/// `results.csv` without the column of seconds, the last one.
fn results(folder: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(folder.join("results.csv")).unwrap();
    text.lines().map(|line| line.rsplit_once(',').unwrap().0.to_owned()).collect()
}

/// Writes a sweep of two cells, each of a few seconds, with a checkpoint every 3 iterations.
/// Returns its path.
fn sweep(folder: &Path) -> String {
    let text = format!(
        r#"title = "killed"
iterations = 48
seeds = [1]
[gradient]
size = 6
spp = 2
runs = 2
[fixed]
width = 16
layers = 2
grid = "none"
batch = 128
checkpoint_every = 3
[parameters]
estimator = ["refined", "paper"]
[[data]]
name = "pebble"
scene = {:?}
views = 6
size = 24
"#,
        root().join("xtask/sweeps/scenes/pebble.json").to_string_lossy()
    );
    let path = folder.join("sweep.toml");
    std::fs::write(&path, text).unwrap();
    path.to_string_lossy().into_owned()
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// The most iterations of an unfinished cell.
fn iterations_of_unfinished_cells(output: &Path) -> usize {
    let cells = std::fs::read_dir(output.join("cells")).into_iter().flatten().flatten();
    let unfinished = cells.filter(|cell| !cell.path().join("result.json").exists());
    let lines = |path: &Path| std::fs::read_to_string(path).map_or(0, |t| t.lines().count());
    unfinished.map(|cell| lines(&cell.path().join("run/metrics.jsonl"))).max().unwrap_or(0)
}

/// Starts the sweep, and kills it (SIGKILL) in the middle of a fit, after more iterations than
/// before.
fn kill_in_the_middle(sweep: &str, output: &Path) {
    let before = iterations_of_unfinished_cells(output);
    let arguments = [sweep, "-o", &text(output), "--jobs", "2"];
    let mut child = ablate(&arguments).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    let in_the_middle = |iterations| iterations > before + 3 && iterations < 42;
    while !in_the_middle(iterations_of_unfinished_cells(output)) {
        assert!(child.try_wait().unwrap().is_none(), "the sweep ended before it could be killed");
        assert!(start.elapsed() < Duration::from_secs(120), "no cell begins");
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn killed_and_sharded_sweeps_give_the_results_of_an_uninterrupted_one() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = sweep(folder.path());
    let [whole, killed, parts] = ["whole", "killed", "parts"].map(|name| folder.path().join(name));
    run(&[&sweep, "-o", &text(&whole), "--jobs", "2"]);
    let expected = results(&whole);
    assert_eq!(expected.len(), 3);
    assert!(expected[1..].iter().all(|row| row.contains(",done,")), "{expected:#?}");

    kill_in_the_middle(&sweep, &killed);
    kill_in_the_middle(&sweep, &killed);
    run(&[&sweep, "-o", &text(&killed), "--jobs", "2"]);
    assert_eq!(expected, results(&killed), "after two kills");

    // A finished cell is not run again.
    let cell = std::fs::read_dir(whole.join("cells")).unwrap().next().unwrap().unwrap();
    let result = cell.path().join("result.json");
    let written = std::fs::metadata(&result).unwrap().modified().unwrap();
    run(&[&sweep, "-o", &text(&whole)]);
    assert_eq!(written, std::fs::metadata(&result).unwrap().modified().unwrap());

    let merged = run_in_shards(&sweep, &parts, &folder.path().join("merged"));
    assert_eq!(expected, results(Path::new(&merged)), "of two shards");

    let compared = run(&["--compare", &text(&whole), &merged]);
    let page = String::from_utf8_lossy(&compared.stdout).into_owned();
    assert!(
        page.contains("2 cells in common, 0 only in A") && page.contains("| 100 % |"),
        "{page}"
    );
}

/// Runs the sweep in two shards and merges them. Returns the merged folder.
fn run_in_shards(sweep: &str, parts: &Path, merged: &Path) -> String {
    for shard in ["1/2", "2/2"] {
        run(&[sweep, "-o", &text(parts), "--shard", shard]);
    }
    let shards = [1, 2].map(|i| text(&parts.join(format!("shards/{i}-of-2"))));
    let merged = text(merged);
    let mut merge = vec![sweep, "-o", &merged, "--merge"];
    merge.extend(shards.iter().map(String::as_str));
    run(&merge);
    merged
}

#[test]
fn smoke_sweep_writes_all_files_of_a_sweep() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("smoke");
    run(&["smoke", "-o", &text(&output)]);
    let rows = results(&output);
    assert_eq!(rows.len(), 5);
    for row in &rows[1..] {
        assert!(row.contains(",done,") && !row.contains(",,,"), "{row}");
    }
    for file in ["report.md", "report.html", "heat.svg", "curves.svg", "pareto.svg"] {
        let text = std::fs::read_to_string(output.join(file)).unwrap();
        // The base64 of a picture may contain any word.
        let text = text.split("base64").next().unwrap().to_owned();
        assert!(text.len() > 500 && !text.contains("NaN"), "{file}");
    }
    let report = std::fs::read_to_string(output.join("report.md")).unwrap();
    assert!(
        report.contains("4 of 4 cells") && report.contains("γ = 6 is worse than 3 | **"),
        "{report}"
    );
    let grid = image::open(output.join("grid.png")).unwrap().to_rgb8();
    assert!(
        grid.width() > 250 && grid.pixels().any(|p| p.0[0] > 60 && p.0[0] < 200),
        "an empty grid"
    );
    let plan = run(&["smoke", "--dry-run", "-o", &text(&output)]);
    assert!(String::from_utf8_lossy(&plan.stdout).contains("4 cells, 0 to run"), "{plan:?}");
}

/// A replacement in the sweep's file, and two parts of its refusal: field and expected value.
type WrongSweep = (&'static str, &'static str, &'static str, &'static str);

const LAST: &str = "\"paper\"]";

#[rustfmt::skip]
const WRONG_SWEEPS: [WrongSweep; 16] = [
    ("width = 16", "wdth = 16", "fixed.wdth", "an option of `dsdf fit`"),
    (LAST, "\"paper\"]\ntop_k = [1, 7]", "parameters.top_k: found 1", "2 or more"),
    (LAST, "\"paper\"]\ngamma = [0.0]", "parameters.gamma: found 0", "a finite number above 0"),
    (LAST, "\"paper\"]\ngamma = [-2]", "parameters.gamma: found -2", "a finite number above 0"),
    (LAST, "\"paper\"]\nN = [0]", "parameters.N: found 0", "1 to 65536"),
    (LAST, "\"papre\"]", "parameters.estimator: found papre", "one of refined, paper"),
    (LAST, "\"paper\"]\npreset = [\"fats\"]", "parameters.preset: found fats", "one of fast"),
    ("width = 16", "width = 1.5", "fixed.width: found 1.5 (invalid digit", "`dsdf fit` accepts"),
    ("runs = 2", "runs = 1", "gradient.runs: found 1", "2 or more"),
    (LAST, "\"paper\"]\nseed = [3]", "parameters.seed", "seeds"),
    ("[\"refined\", \"paper\"]", "[]", "parameters.estimator: found []", "one value or more"),
    ("title", "titel", "line 1", "unknown field"),
    ("\"killed\"", "\"kil\\nled\"", "title", "one line"),
    ("width = 16", "preview-every = 9", "preview-every", "underscores"),
    (LAST, "\"paper\"]\nN = [9999999]", "parameters.N: found 9999999", "1 to 65536"),
    ("seeds = [1]", "seeds = [1]\npackage = \"a\"\nprofile = \"fast\"", "line 5",
     "unknown variant"),
];

#[test]
fn wrong_sweeps_are_refused_before_any_cell() {
    let folder = tempfile::tempdir().unwrap();
    let good = std::fs::read_to_string(sweep(folder.path())).unwrap();
    let output = folder.path().join("out");
    let path = folder.path().join("bad.toml");
    for (from, to, field, expected) in WRONG_SWEEPS {
        std::fs::write(&path, good.replacen(from, to, 1)).unwrap();
        let message = refusal(&[&text(&path), "-o", &text(&output)]);
        for part in ["bad.toml", field, expected] {
            assert!(message.contains(part), "{to}: no {part:?} in {message}");
        }
        assert!(!output.exists(), "{to} left a folder");
    }
}

#[test]
fn wrong_arguments_are_refused() {
    for arguments in [
        &["nothing", "-o", "x"][..],
        &["smoke", "-o", "x", "--shard", "5/4"],
        &["smoke", "-o", "x", "--only", "γ"],
        &["smoke"],
        &["smoke", "-o", "x", "--jobs", "0"],
        &["--compare", "nothing", "nowhere"],
    ] {
        refusal(arguments);
    }
}
