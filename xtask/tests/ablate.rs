//! Sweeps as a user runs them: small ones, to the end, killed, in parts, and refused.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use tests::{binary, root};

fn ablate(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    command.arg("ablate").args(arguments).arg("--binary").arg(binary()).current_dir(root());
    command
}

fn run(arguments: &[&str]) -> Output {
    let output = ablate(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "ablate {arguments:?}: {said}");
    output
}

/// `results.csv` without the column of seconds, the last one.
fn results(folder: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(folder.join("results.csv")).unwrap();
    text.lines().map(|line| line.rsplit_once(',').unwrap().0.to_owned()).collect()
}

/// A sweep of four cells of a few seconds, with a checkpoint every few iterations.
fn sweep(folder: &Path) -> String {
    let scene = root().join("xtask/sweeps/scenes/pebble.json");
    let text = format!(
        "title = \"killed\"\niterations = 160\nseeds = [1, 2]\n[gradient]\nsize = 6\nspp = 2\nruns = 2\n\
         [fixed]\nwidth = 16\nlayers = 2\nbatch = 128\ncheckpoint_every = 20\n[parameters]\nestimator = [\"refined\", \"paper\"]\n\
         [[data]]\nname = \"pebble\"\nscene = {:?}\nviews = 6\nsize = 24\n",
        scene.to_string_lossy()
    );
    let path = folder.join("sweep.toml");
    std::fs::write(&path, text).unwrap();
    path.to_string_lossy().into_owned()
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// Starts the sweep, and kills it (SIGKILL) when some cell that had not begun before is in the
/// middle of its fit.
fn kill_in_the_middle(sweep: &str, output: &Path) {
    let lines = |output: &Path| -> usize {
        let cells = std::fs::read_dir(output.join("cells")).into_iter().flatten().flatten();
        let fits = cells.filter(|cell| !cell.path().join("result.json").exists());
        let length =
            |path: &Path| std::fs::read_to_string(path).map_or(0, |text| text.lines().count());
        fits.map(|cell| length(&cell.path().join("run/metrics.jsonl"))).max().unwrap_or(0)
    };
    let before = lines(output);
    let arguments = [sweep, "-o", &text(output), "--jobs", "2"];
    let mut child = ablate(&arguments).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    while !(lines(output) > before + 5 && lines(output) < 150) {
        assert!(child.try_wait().unwrap().is_none(), "the sweep ended before it could be killed");
        assert!(start.elapsed() < Duration::from_secs(120), "no cell begins");
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn killed_and_sharded_sweeps_give_what_an_undisturbed_one_does() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = sweep(folder.path());
    let [whole, killed, parts] = ["whole", "killed", "parts"].map(|name| folder.path().join(name));
    run(&[&sweep, "-o", &text(&whole), "--jobs", "2"]);
    assert_eq!(results(&whole).len(), 5);
    assert!(
        results(&whole)[1..].iter().all(|row| row.contains(",done,")),
        "{:#?}",
        results(&whole)
    );

    kill_in_the_middle(&sweep, &killed);
    kill_in_the_middle(&sweep, &killed);
    run(&[&sweep, "-o", &text(&killed), "--jobs", "2"]);
    assert_eq!(results(&whole), results(&killed), "after two kills");

    // Nothing is run twice.
    let cell = std::fs::read_dir(whole.join("cells"))
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .path()
        .join("result.json");
    let written = std::fs::metadata(&cell).unwrap().modified().unwrap();
    run(&[&sweep, "-o", &text(&whole)]);
    assert_eq!(written, std::fs::metadata(&cell).unwrap().modified().unwrap());

    for shard in ["1/4", "2/4", "3/4", "4/4"] {
        run(&[&sweep, "-o", &text(&parts), "--shard", shard]);
    }
    let merged = folder.path().join("merged");
    let shards: Vec<String> =
        (1..=4).map(|i| text(&parts.join(format!("shards/{i}-of-4")))).collect();
    let merged_name = text(&merged);
    let mut merge = vec![sweep.as_str(), "-o", merged_name.as_str(), "--merge"];
    merge.extend(shards.iter().map(String::as_str));
    run(&merge);
    assert_eq!(results(&whole), results(&merged), "of four shards");

    let compared = run(&["--compare", &text(&whole), &text(&merged)]);
    let page = String::from_utf8_lossy(&compared.stdout).into_owned();
    assert!(
        page.contains("4 cells in common, 0 only in A") && page.contains("| 100 % |"),
        "{page}"
    );
}

#[test]
fn the_smoke_sweep_leaves_all_that_a_sweep_does() {
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
        // A picture's bytes may spell anything.
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

#[test]
fn what_cannot_be_swept_is_refused_before_any_cell() {
    let folder = tempfile::tempdir().unwrap();
    let good = std::fs::read_to_string(sweep(folder.path())).unwrap();
    let output = folder.path().join("out");
    for (from, to, field, expected) in [
        ("width = 16", "wdth = 16", "fixed.wdth", "an option of `dsdf fit`"),
        ("\"paper\"]", "\"paper\"]\ntop_k = [1, 7]", "parameters.top_k: found 1", "2 or more"),
        (
            "\"paper\"]",
            "\"paper\"]\ngamma = [0.0]",
            "parameters.gamma: found 0",
            "a number above 0",
        ),
        (
            "\"paper\"]",
            "\"paper\"]\ngamma = [-2]",
            "parameters.gamma: found -2",
            "a number above 0",
        ),
        ("\"paper\"]", "\"paper\"]\nN = [0]", "parameters.N: found 0", "1 to 65536"),
        ("\"paper\"]", "\"papre\"]", "parameters.estimator: found papre", "interior, paper"),
        ("\"paper\"]", "\"custom\"]", "parameters.estimator: found custom", "weights of their own"),
        ("\"paper\"]", "\"paper\"]\nseed = [3]", "parameters.seed", "seeds"),
        ("[\"refined\", \"paper\"]", "[]", "parameters.estimator: found []", "one value or more"),
        ("title", "titel", "line 1", "unknown field"),
        ("\"killed\"", "\"kil\\nled\"", "title", "one line"),
        ("width = 16", "preview-every = 9", "preview-every", "underscores"),
        ("\"paper\"]", "\"paper\"]\nN = [9999999]", "parameters.N: found 9999999", "1 to 65536"),
        (
            "seeds = [1, 2]",
            "seeds = [1]\npackage = \"a\"\nprofile = \"fast\"",
            "line 5",
            "unknown variant",
        ),
    ] {
        let path = folder.path().join("bad.toml");
        std::fs::write(&path, good.replacen(from, to, 1)).unwrap();
        let refused = ablate(&[&text(&path), "-o", &text(&output)]).output().unwrap();
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{to}: {said}");
        let one = said.lines().count() == 1;
        assert!(
            one && said.contains("bad.toml") && said.contains(field) && said.contains(expected),
            "{to}: {said}"
        );
        assert!(!output.exists(), "{to} left a folder");
    }
    for arguments in [
        &["nothing", "-o", "x"][..],
        &["smoke", "-o", "x", "--shard", "5/4"],
        &["smoke", "-o", "x", "--only", "γ"],
        &["smoke"],
        &["smoke", "-o", "x", "--jobs", "0"],
        &["--compare", "nothing", "nowhere"],
    ] {
        let refused = ablate(arguments).output().unwrap();
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(
            refused.status.code() == Some(2) && said.lines().count() == 1,
            "{arguments:?}: {said}"
        );
    }
}
