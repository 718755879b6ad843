//! A fit on the command line: its summary, its warnings, its lines of progress and its verdict.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::process::{Command, Output};

use serde_json::Value;

use tests::input::{Folder, ball};
use tests::{binary, dsdf_json};

/// Runs `dsdf --json` without `--quiet`; standard error is no terminal.
fn talking(arguments: &[&str]) -> (Value, Vec<String>) {
    let output = Command::new(binary()).args(arguments).arg("--json").output().unwrap();
    let Output { status, stdout, stderr } = output;
    let stderr = String::from_utf8(stderr).unwrap();
    assert!(status.success(), "{stderr}");
    (serde_json::from_slice(&stdout).unwrap(), stderr.lines().map(str::to_owned).collect())
}

#[test]
fn a_fit_prints_its_assumptions_and_its_verdict() {
    let folder = Folder::new();
    let (data, run) = (ball(&folder, "6"), folder.path("run"));
    let fit = ["fit", &data, "-o", &run, "--iterations", "300", "--batch", "256"];
    let (report, lines) = talking(&fit);
    let summary: Vec<&str> = lines.iter().map(|l| l.split_once(':').unwrap().0).collect();
    // A fit that takes longer than ten seconds adds lines of progress.
    assert_eq!(summary[..5], ["views", "sphere", "background", "masks", "exposure"], "{lines:?}");
    assert!(summary[5..].iter().all(|name| ["fit", "cameras"].contains(name)), "{lines:?}");
    let cameras = lines.iter().find(|line| line.starts_with("cameras:")).unwrap();
    assert!(cameras.contains("it needs 640 iterations before it, and the budget gives 16"));
    for (line, words) in [
        (0, "6 to fit, 1 held out, 32 x 32 pixels"),
        (1, "from outlines in front of plain backgrounds"),
        (2, "one colour (confidence that one colour explains it: 1.00 of 1)"),
        (3, "of the object in 7 views, not used"),
        (4, "not known"),
    ] {
        assert!(lines[line].contains(words), "no {words:?} in {lines:?}");
    }
    let verdict = &report["verdict"];
    assert_eq!((&verdict["fault"], &verdict["training_views"]), (&Value::Null, &6.into()));
    assert!(verdict["training_match"].as_f64().unwrap() > 22.0, "{verdict}");
    assert_eq!(verdict["surface"]["on_sphere"], 0.0);
    // The run has it too.
    let picture = folder.path("i.png");
    let inspected = dsdf_json(&["inspect", &run, "-o", &picture]);
    assert_eq!(&inspected["verdict"], verdict);
    assert!(dsdf_json(&["inspect", &data, "-o", &picture])["verdict"].is_null());
}

#[test]
fn a_sphere_that_cuts_the_object_is_found() {
    let folder = Folder::new();
    let (data, run) = (ball(&folder, "6"), folder.path("run"));
    let options = ["--iterations", "300", "--batch", "256", "--bounds", "0.4,0,0,0.5"];
    let verdict = &dsdf_json(&[&["fit", &data, "-o", &run], &options[..]].concat())["verdict"];
    assert_eq!(verdict["fault"], "small-sphere", "{verdict}");
    assert!(verdict["text"].as_str().unwrap().contains("--bounds"), "{verdict}");
    assert!(verdict["surface"]["seen_on_sphere"].as_f64().unwrap() > 0.1, "{verdict}");
}

#[test]
fn a_stopped_fit_has_no_verdict_and_a_resumed_one_repeats_the_warnings() {
    let folder = Folder::new();
    let (data, run) = (ball(&folder, "2"), folder.path("run"));
    let warning = "WARNING fewer than three views to fit";
    let start = ["fit", &data, "-o", &run, "--iterations", "4", "--batch", "16"];
    let (report, lines) = talking(&[&start[..], &["--stop-after", "2"]].concat());
    assert!(report["verdict"].is_null() && lines[5].contains(warning), "{report} {lines:?}");
    let (report, lines) = talking(&["fit", "-o", &run, "--resume"]);
    assert!(lines[1].contains("from the run") && lines[5].contains(warning), "{lines:?}");
    assert!(report["verdict"]["text"].is_string(), "{report}");
    let quiet = ["fit", &data, "-o", &folder.path("quiet"), "--iterations", "2", "--batch", "16"];
    let quiet = Command::new(binary()).args(quiet).arg("--quiet").output().unwrap();
    assert!(quiet.status.success() && quiet.stderr.is_empty(), "{quiet:?}");
}

#[test]
fn a_fit_without_a_terminal_prints_a_line_every_ten_seconds() {
    let folder = Folder::new();
    let (data, run) = (ball(&folder, "6"), folder.path("run"));
    let (_, lines) = talking(&["fit", &data, "-o", &run, "--time", "12s", "--batch", "64"]);
    let progress: Vec<&String> = lines.iter().filter(|line| line.starts_with("fit: ")).collect();
    assert_eq!(progress.len(), 1, "{lines:?}");
    for words in [" %, 0:", " elapsed, 0:0", " left, ", " iterations", "loss 0.", " dB"] {
        assert!(progress[0].contains(words), "no {words:?} in {progress:?}");
    }
}
